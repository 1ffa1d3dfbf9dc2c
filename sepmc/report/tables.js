// Tables of the report: sorting by the button in a head, filtering by a text box.
"use strict";
(() => {
  // The number that a cell begins with; NaN if it begins with none.
  const number = (text) => parseFloat(text.replace(/,/g, ""));

  function sort(table, column, head) {
    const down = head.getAttribute("aria-sort") === "ascending";
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    const rows = [...table.tBodies[0].rows].map((row) => [row.cells[column].innerText.trim(), row]);
    const numeric = rows.some(([text]) => !isNaN(number(text))) &&
      rows.every(([text]) => !isNaN(number(text)) || text === "" || text.startsWith("-"));
    rows.sort(([a], [b]) => {
      if (!numeric) return a.localeCompare(b, undefined, { numeric: true });
      const [x, y] = [number(a), number(b)];
      return isNaN(x) || isNaN(y) ? isNaN(x) - isNaN(y) : x - y;
    });
    if (down) rows.reverse();
    table.tBodies[0].append(...rows.map(([, row]) => row));
  }

  function filter(table, text, count) {
    const words = text.toLowerCase().split(/\s+/);
    let shown = 0;
    for (const row of table.tBodies[0].rows) {
      const own = row.textContent.toLowerCase();
      row.hidden = !words.every((word) => own.includes(word));
      shown += !row.hidden;
    }
    count.textContent = text.trim() ? `${shown} of ${table.tBodies[0].rows.length} rows` : "";
  }

  for (const table of document.querySelectorAll("table")) {
    if (table.tBodies[0].rows.length < 2) continue;
    [...table.tHead.rows[0].cells].forEach((head, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.append(...head.childNodes);
      button.onclick = () => sort(table, column, head);
      head.append(button);
    });
    const label = document.createElement("label"), box = document.createElement("input");
    const count = document.createElement("output");
    label.className = "filter";
    box.type = "search";
    box.oninput = () => filter(table, box.value, count);
    label.append("Filter rows ", box, " ", count);
    table.parentElement.before(label);
  }
})();
