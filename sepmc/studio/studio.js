// The page of `sepmc studio`: sliders ask the server to run the cases again, and the answer is drawn.
"use strict";
(() => {
  const $ = (id) => document.getElementById(id), { number } = sepmcFigures;
  const state = new Map();  // by key: its slider, value and factor of its spread
  let recent = [];  // keys of values, the one moved last first
  let base = {}, answer = null, names = [], mapped = null;
  let running = false, again = false, moment = null;
  window.sepmcTimes = [];  // ms from a move to its picture

  const made = (name, properties = {}, ...children) => {
    const one = Object.assign(document.createElement(name), properties);
    one.append(...children);
    return one;
  };
  async function ask(what, more = {}) {
    const values = {}, spreads = {};
    for (const [key, one] of state) {
      if (one.value !== one.slider.value) values[key] = one.value;
      if (one.factor !== 1) spreads[one.slider.spread] = one.factor;
    }
    const question = { values, spreads, cases: Number($("cases").value),
      seed: Number($("seed").value), outcomes: names, ...more };
    const reply = await fetch(what, { method: "POST", body: JSON.stringify(question) });
    const content = await reply.json();
    if (!reply.ok) throw new Error(content.error);
    return content;
  }
  function status(text, kind = "") {
    $("status").textContent = text;
    $("status").className = kind;
  }

  // One run at a time; the next one takes the positions of then.
  async function refresh() {
    moment ??= performance.now();
    if (running) { again = true; return; }
    running = true;
    status("running", "busy");
    const waiting = setInterval(async () => {
      const { message } = await (await fetch("message")).json();
      if (running && message) status(message, "busy");
    }, 700);
    do {
      const begin = moment;
      [again, moment] = [false, null];
      try {
        answer = await ask("run");
        if (!names.length) names = Object.keys(answer.outcomes);
        draw();
        await new Promise((done) => requestAnimationFrame(() => setTimeout(done)));
        window.sepmcTimes.push(performance.now() - begin);
        status(`${answer.cases.toLocaleString("en")} cases in ${number(answer.seconds, 2)} s`);
      } catch (error) {
        status(error.message, "fault");
      }
    } while (again);
    clearInterval(waiting);
    running = false;
    if ($("live").checked) fly();
  }

  function draw() {
    if (!changes()) base = { ...base, ...answer.outcomes };
    $("notes").replaceChildren(...answer.notes.map((text) =>
      made("p", { className: "warning", textContent: text })));
    if (answer.audit_failed) {
      $("notes").append(made("p", { className: "warning", textContent: "the audit failed" }));
    }
    $("counts").textContent = answer.counts.join("; ");
    $("verdicts")?.replaceChildren(...answer.verdicts.map(verdict));
    $("figures").replaceChildren(...names.filter((name) => answer.outcomes[name]).map(figure));
    choices($("outcome"), [["", "..."], ...answer.ranked.filter((name) => !names.includes(name))
      .map((name) => [name, name])]);
    const worst = answer.verdicts.filter((v) => v.case !== null)
      .map((v) => [`requirement ${v.name}`, `worst of ${v.name}: case ${v.case}`]);
    const ends = names.filter((name) => answer.outcomes[name]?.case_min !== null && answer.outcomes[name])
      .flatMap((name) => ["min", "max"].map((end) => [`${end} ${name}`,
        `${end} of ${name}: case ${answer.outcomes[name][`case_${end}`]}`]));
    choices($("which"), [...worst, ...ends]);
    drawMap();
  }
  const changes = () => [...state.values()].some((one) =>
    one.value !== one.slider.value || one.factor !== 1);
  function choices(select, list) {
    const before = select.value;
    select.replaceChildren(...list.map(([value, text]) => new Option(text, value)));
    if (list.some(([value]) => value === before)) select.value = before;
  }
  function verdict(v) {
    const cell = (text, quiet) => {
      const one = made("td", { textContent: text });
      if (quiet) one.append(made("br"), made("span", { className: "quiet", textContent: quiet }));
      return one;
    };
    const words = cell(v.sentence, [v.why, v.missing].filter(Boolean).join("; "));
    words.className = "words";
    return made("tr", {}, made("td", {}, made("span", { className: `verdict ${v.style}`,
      textContent: v.verdict })), words, cell(v.violations), cell(v.allowed),
    cell(v.share), cell(v.case === null ? v.worst : `${v.worst} (case ${v.case})`), cell(v.design));
  }
  function figure(name) {
    const now = answer.outcomes[name], unit = now.unit;
    const remove = made("button", { type: "button", className: "remove", textContent: "\u00d7",
      title: `Remove ${name}`, onclick: () => {
        names = names.filter((one) => one !== name);
        draw();
      } });
    remove.setAttribute("aria-label", `Remove ${name}`);
    const text = `mean ${number(now.mean)}, sigma ${number(now.sigma, 3)}, ` +
      `${number(now.min)} to ${number(now.max)} ${unit}`;
    return made("figure", {}, made("figcaption", { textContent: now.title }), remove,
      sepmcFigures.histogram(name, now, base[name]), made("p", { className: "quiet", textContent: text }));
  }
  $("outcome").onchange = () => {
    names.push($("outcome").value);
    refreshAll();
  };
  // Outcomes that the file's own run has not drawn yet are asked of it first.
  async function refreshAll() {
    const missing = names.filter((name) => !base[name]);
    if (missing.length && changes()) {
      const own = await ask("run", { values: {}, spreads: {} });
      base = { ...base, ...own.outcomes };
    }
    refresh();
  }

  function addSlider(slider) {
    if (state.has(slider.key)) return state.get(slider.key).row.querySelector("input").focus();
    const one = { slider, value: slider.value, factor: 1 };
    state.set(slider.key, one);
    const reset = made("button", { type: "button", className: "reset", textContent: "reset" });
    reset.setAttribute("aria-label", `Reset ${slider.key}`);
    const line = (label, low, high, start, change) => {
      const range = made("input", { type: "range", step: "any", min: low, max: high, value: start });
      const exact = made("input", { type: "number", step: "any", value: start });
      range.setAttribute("aria-label", `${label} of ${slider.key}`);
      exact.setAttribute("aria-label", `${label} of ${slider.key}, exactly`);
      range.step = (high - low) / 200;
      const put = (value) => {
        if (value < Number(range.min)) range.min = value;
        if (value > Number(range.max)) range.max = value;
        range.value = exact.value = value;
      };
      const move = (value) => {
        if (!Number.isFinite(value)) return;
        change(value);
        row.classList.toggle("moved", one.value !== slider.value || one.factor !== 1);
        refresh();
      };
      range.oninput = () => {
        const value = Number(Number(range.value).toPrecision(6));
        exact.value = value;
        move(value);
      };
      exact.onchange = () => { put(exact.valueAsNumber); move(exact.valueAsNumber); };
      return { put, row: made("div", { className: "row" },
        made("span", { textContent: label }), range, exact) };
    };
    const value = line("value", slider.low, slider.high, slider.value, (x) => {
      one.value = x;
      recent = [slider.key, ...recent.filter((key) => key !== slider.key)];
      if (recent.length > 1) $("mapping") && ($("mapping").textContent = `${recent[0]} and ${recent[1]}`);
    });
    const spread = slider.spread &&
      line("spread", 0, 3, 1, (x) => { one.factor = x; });
    const row = made("fieldset", { className: "slider" },
      made("legend", {}, `${slider.key} `, reset), value.row, ...(spread ? [spread.row] : []));
    if (slider.distribution) {
      row.append(made("p", { className: "distribution", textContent: `file: ${slider.distribution}` }));
    }
    one.row = row;
    one.reset = () => {
      [one.value, one.factor] = [slider.value, 1];
      value.put(slider.value);
      if (spread) spread.put(1);
      row.classList.remove("moved");
    };
    reset.onclick = () => { one.reset(); refresh(); };
    return row;
  }

  $("adding").onsubmit = async (event) => {
    event.preventDefault();
    try {
      const row = addSlider(await ask("slider", { key: $("added").value.trim() }));
      if (row) {
        $("sliders").prepend(row);
        row.querySelector("input").focus();
      }
      $("added").value = "";
    } catch (error) {
      status(error.message, "fault");
    }
  };
  $("reset").onclick = () => { for (const one of state.values()) one.reset(); refresh(); };
  $("cases").onchange = $("seed").onchange = async () => {
    base = {};
    if (changes()) base = (await ask("run", { values: {}, spreads: {} })).outcomes;
    refresh();
  };
  for (const button of document.querySelectorAll("[data-copy]")) {
    button.onclick = async () => {
      try {
        const text = (await ask("settings"))[button.dataset.copy];
        $("text").textContent = text;
        $("text").hidden = false;
        await navigator.clipboard.writeText(text).then(
          () => status("copied"), () => status("shown below the buttons"));
      } catch (error) {
        status(error.message, "fault");
      }
    };
  }

  // A case over time. The server simulates it in a second process.
  let flying = false, next = false;
  async function fly() {
    if (flying) { next = true; return; }
    const [end, ...rest] = $("which").value.split(" "), name = rest.join(" ");
    const number = end === "requirement" ? answer.verdicts.find((v) => v.name === name)?.case
      : answer.outcomes[name]?.[`case_${end}`];
    if (number === undefined || number === null) return;
    flying = true;
    $("flying").textContent = `simulating case ${number}`;
    try {
      sepmcReplays.set(await ask("replay", { case: number }));
      $("flying").textContent = "";
    } catch (error) {
      $("flying").textContent = error.message;
    }
    flying = false;
    if (next) { next = false; fly(); }
  }
  $("fly").onclick = fly;
  $("which").onchange = $("live").onchange = () => { if ($("live").checked) fly(); };

  function drawMap() {
    if (!mapped) return;
    choices($("required"), Object.keys(mapped.requirements).map((name) => [name, name]));
    const at = mapped.axes.map(({ key }) => state.get(key).value);
    $("chart").replaceChildren(sepmcFigures.map(mapped, $("required").value, at));
  }
  if ($("map")) {
    $("required").onchange = drawMap;
    $("map").onclick = async () => {
      const keys = recent.slice(0, 2);
      if (keys.length < 2) return;
      $("mapping").textContent = `running designs over ${keys.join(" and ")}`;
      const axes = keys.map((key) => [key, state.get(key).slider.low, state.get(key).slider.high]);
      try {
        mapped = await ask("map", { axes });
        $("mapping").textContent = `${mapped.cases} cases a design; green shown, red refuted, grey ` +
          "open; numbers: violating cases; cross: the sliders. Other settings as they were then.";
        drawMap();
      } catch (error) {
        $("mapping").textContent = error.message;
      }
    };
  }

  $("sliders").append(...JSON.parse($("start").textContent).map(addSlider));
  refresh();
})();
