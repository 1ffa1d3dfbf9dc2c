// Case numbers of the report: a click opens the replay of a case, or shows the command that makes one.
"use strict";
const sepmcCases = (() => {
  const bar = document.getElementById("command"), source = document.getElementById("replay-data");
  sepmcReplays.set(source ? JSON.parse(source.textContent) : []);

  function open(number) {
    if (sepmcReplays.has(number)) return sepmcReplays.open(number);
    bar.querySelector("code").textContent = `sepmc replay ${bar.dataset.run} --case ${number}`;
    bar.hidden = false;
  }

  for (const link of document.querySelectorAll(".case")) {
    const number = Number(link.textContent);
    if (link.tagName === "A" && sepmcReplays.has(number)) {
      link.onclick = (event) => { event.preventDefault(); open(number); };
    }
    if (link.tagName === "A") continue;
    const button = document.createElement("button");
    button.type = "button";
    button.className = "case";
    button.textContent = number;
    button.title = `Show how to replay case ${number}`;
    button.onclick = () => open(number);
    link.replaceWith(button);
  }
  bar.querySelector("button").onclick = () => { bar.hidden = true; };
  return { open };
})();
