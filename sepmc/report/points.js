// A figure of the report that zooms: histogram of an outcome or input with its cases, or one over
// another. Data: `sepmc/report/case_points.py`.
"use strict";
(() => {
  const $ = (id) => document.getElementById(id), source = $("points-data");
  if (!source) return;
  const { cases, columns, total } = JSON.parse(source.textContent);
  if (!columns.length) return;
  const canvas = $("points-canvas"), context = canvas.getContext("2d"), output = $("points-value");
  const [LEFT, RIGHT, TOP, BOTTOM, STRIP, BAR] = [64, 12, 8, 44, 70, 7];  // pixels
  let x, y, view, at = -1, places = [], waiting = false, drag = null;

  const title = (one) => one.unit ? `${one.words} (${one.unit})` : one.words;
  const short = (value) => String(Number(value.toPrecision(6)));
  for (const [select, first] of [[$("points-x"), null], [$("points-y"), "number of cases"]]) {
    if (first) select.append(new Option(first, -1));
    for (const kind of ["outcome", "input"]) {
      const group = document.createElement("optgroup");
      group.label = `${kind}s`;
      columns.forEach((one, k) => one.kind === kind && group.append(new Option(title(one), k)));
      if (group.children.length) select.append(group);
    }
    select.onchange = reset;
  }

  const around = ({ low, high }) => [low - 0.03 * (high - low), high + 0.03 * (high - low)];
  function reset() {
    [x, y] = [columns[$("points-x").value], columns[$("points-y").value] || null];
    view = { x: around(x), y: y ? around(y) : [0, 1] };
    at = -1;
    show();
    redraw();
  }
  function show() {
    const value = (one) => `${one.words} ${short(one.values[at])} ${one.unit}`.trim();
    output.textContent = at < 0 ? ""
      : `case ${cases[at]}: ${value(x)}${y ? `, ${value(y)}` : ""}`;
    canvas.setAttribute("aria-label", `${x.words}${y ? ` and ${y.words}` : ""} of ${cases.length} ` +
      `of ${total} cases. Left and right arrow select a case, Enter opens it, plus and minus zoom, ` +
      `Home resets. ${output.textContent}`);
  }

  // About `count` round numbers from low to high.
  function ticks([low, high], count) {
    const raw = (high - low) / count, unit = 10 ** Math.floor(Math.log10(raw));
    const step = unit * [1, 2, 5, 10].find((k) => k * unit >= raw), list = [];
    for (let k = Math.ceil(low / step); k * step <= high; k++) list.push(k * step);
    return list.map((value) => Number(value.toPrecision(12)));
  }
  function frame() {
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    const floor = height - BOTTOM - (y ? 0 : STRIP);
    return { width, height, floor,
      px: (value) => LEFT + (width - LEFT - RIGHT) * (value - view.x[0]) / (view.x[1] - view.x[0]),
      py: (value) => floor - (floor - TOP) * (value - view.y[0]) / (view.y[1] - view.y[0]) };
  }
  function redraw() {
    if (!waiting) requestAnimationFrame(draw);
    waiting = true;
  }
  function draw() {
    waiting = false;
    const ratio = window.devicePixelRatio || 1, { width, height, floor, px, py } = frame();
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.font = "12px sans-serif";
    context.save();
    context.beginPath();
    context.rect(LEFT, 0, width - LEFT - RIGHT, height - BOTTOM);
    context.clip();
    let most = 0;
    if (!y) most = bars(px, floor);
    places = cases.map((number, k) => {
      if (x.values[k] === null || (y && y.values[k] === null)) return null;
      const share = (number * 0.6180339887498949) % 1;
      return [px(x.values[k]), y ? py(y.values[k]) : floor + 8 + (STRIP - 14) * share];
    });
    context.fillStyle = "#0072B2";
    context.globalAlpha = 0.55;
    for (const place of places) {
      if (place) context.fillRect(place[0] - 1.5, place[1] - 1.5, 3, 3);
    }
    context.globalAlpha = 1;
    context.strokeStyle = "#009E73";
    context.lineWidth = 2;
    for (const bound of x.bounds) line(px(bound), TOP, px(bound), height - BOTTOM);
    for (const bound of y ? y.bounds : []) line(LEFT, py(bound), width - RIGHT, py(bound));
    if (places[at]) {
      context.strokeStyle = "#D55E00";
      context.beginPath();
      context.arc(...places[at], 6, 0, 7);
      context.stroke();
    }
    context.restore();
    axes(px, py, most);
  }
  function line(x0, y0, x1, y1) {
    context.beginPath();
    context.moveTo(x0, y0);
    context.lineTo(x1, y1);
    context.stroke();
  }
  // Bars of bins that are taken together until they are wide enough; returns the largest count.
  function bars(px, floor) {
    const width = (x.high - x.low) / x.counts.length, start = (k) => x.low + k * width;
    const each = Math.max(1, Math.ceil(BAR / (px(start(1)) - px(start(0))))), list = [];
    for (let k = 0; k < x.counts.length; k += each) {
      const end = Math.min(k + each, x.counts.length);
      if (start(end) < view.x[0] || start(k) > view.x[1]) continue;
      const count = x.counts.slice(k, end).reduce((a, b) => a + b, 0);
      list.push([px(start(k)), px(start(end)), count]);
    }
    const most = Math.max(1, ...list.map(([, , count]) => count));
    context.fillStyle = "#a9cdea";
    for (const [from, to, count] of list) {
      const size = (floor - TOP) * count / most;
      context.fillRect(from, floor - size, Math.max(1, to - from - 0.6), size);
    }
    return most;
  }
  function axes(px, py, most) {
    const { width, height, floor } = frame();
    context.fillStyle = context.strokeStyle = "#1b1f23";
    context.lineWidth = 1;
    line(LEFT, height - BOTTOM, width - RIGHT, height - BOTTOM);
    line(LEFT, TOP, LEFT, floor);
    context.textAlign = "center";
    for (const value of ticks(view.x, 8)) context.fillText(short(value), px(value), height - 28);
    context.fillText(title(x), (LEFT + width - RIGHT) / 2, height - 8);
    context.textAlign = "right";
    const marks = y ? ticks(view.y, 5) : ticks([0, most], 4);
    for (const value of marks) {
      const place = y ? py(value) : floor - (floor - TOP) * value / most;
      context.fillText(short(value), LEFT - 6, place + 4);
    }
    context.save();
    context.translate(13, (TOP + floor) / 2);
    context.rotate(-Math.PI / 2);
    context.textAlign = "center";
    context.fillText(y ? title(y) : "cases", 0, 0);
    context.restore();
  }

  function zoom(factor, px = null, py = null) {
    const { width, floor } = frame();
    const shares = { x: px === null ? 0.5 : (px - LEFT) / (width - LEFT - RIGHT),
      y: py === null ? 0.5 : (floor - py) / (floor - TOP) };
    for (const axis of y ? ["x", "y"] : ["x"]) {
      const [low, high] = view[axis], share = Math.min(1, Math.max(0, shares[axis]));
      const middle = low + share * (high - low), size = (high - low) / factor;
      const all = axis === "x" ? x : y;
      if (size > 4 * (all.high - all.low) || size < 1e-6 * (all.high - all.low)) continue;
      view[axis] = [middle - share * size, middle + (1 - share) * size];
    }
    redraw();
  }
  function select(k) {
    at = k;
    show();
    redraw();
  }
  function nearest(px, py) {
    let [best, least] = [-1, 14 ** 2];
    places.forEach((place, k) => {
      const distance = place ? (place[0] - px) ** 2 + (place[1] - py) ** 2 : Infinity;
      if (distance < least) [best, least] = [k, distance];
    });
    return best;
  }
  // The case with the next higher or lower value in view.
  function step(by) {
    const inside = cases.map((_, k) => k).filter((k) => places[k] &&
      x.values[k] >= view.x[0] && x.values[k] <= view.x[1]);
    inside.sort((a, b) => x.values[a] - x.values[b] || a - b);
    if (!inside.length) return;
    const k = inside.indexOf(at);
    select(inside[k < 0 ? (by > 0 ? 0 : inside.length - 1)
      : Math.min(inside.length - 1, Math.max(0, k + by))]);
  }

  canvas.onpointerdown = (event) => {
    canvas.setPointerCapture(event.pointerId);
    drag = { x: event.offsetX, y: event.offsetY, moved: false };
  };
  canvas.onpointermove = (event) => {
    if (!drag) return select(nearest(event.offsetX, event.offsetY));
    const { width, floor } = frame(), [dx, dy] = [event.offsetX - drag.x, event.offsetY - drag.y];
    if (!drag.moved && Math.hypot(dx, dy) < 4) return;
    Object.assign(drag, { x: event.offsetX, y: event.offsetY, moved: true });
    const shift = -dx * (view.x[1] - view.x[0]) / (width - LEFT - RIGHT);
    view.x = view.x.map((end) => end + shift);
    if (y) {
      const up = dy * (view.y[1] - view.y[0]) / (floor - TOP);
      view.y = view.y.map((end) => end + up);
    }
    redraw();
  };
  canvas.onpointerup = (event) => {
    const k = drag && !drag.moved ? nearest(event.offsetX, event.offsetY) : -1;
    drag = null;
    if (k >= 0) { select(k); sepmcCases.open(cases[k]); }
  };
  canvas.onpointercancel = () => { drag = null; };
  canvas.onwheel = (event) => {
    event.preventDefault();
    zoom(Math.exp(-0.002 * event.deltaY), event.offsetX, event.offsetY);
  };
  canvas.onkeydown = (event) => {
    const act = {
      ArrowLeft: () => step(-1), ArrowRight: () => step(1), "+": () => zoom(1.3),
      "=": () => zoom(1.3), "-": () => zoom(1 / 1.3), Home: reset,
      Enter: () => at >= 0 && sepmcCases.open(cases[at]),
    }[event.key];
    if (act) { event.preventDefault(); act(); }
  };
  $("points-in").onclick = () => zoom(1.5);
  $("points-out").onclick = () => zoom(1 / 1.5);
  $("points-reset").onclick = reset;
  new ResizeObserver(redraw).observe(canvas);
  $("points").hidden = false;
  reset();
})();
