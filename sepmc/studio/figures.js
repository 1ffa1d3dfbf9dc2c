// Figures of the studio as SVG: a histogram over the one of the file, and a map of verdicts.
"use strict";
const sepmcFigures = (() => {
  const COLOURS = { bars: "#a9cdea", base: "#1b1f23", bound: "#009E73", box: "#0072B2",
    pass: "#bfe3d0", fail: "#f6c9b0", other: "#eeeeee" };
  const element = (name, attributes, text) => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    if (text !== undefined) made.textContent = text;
    return made;
  };
  const number = (x, digits = 4) => x === null ? "-" : String(Number(x.toPrecision(digits)));

  // About `count` round numbers from low to high.
  function ticks(low, high, count) {
    const raw = (high - low) / count, unit = 10 ** Math.floor(Math.log10(raw));
    const step = unit * [1, 2, 5, 10].find((k) => k * unit >= raw);
    const list = [];
    for (let k = Math.ceil(low / step); k * step <= high * (1 + 1e-12); k++) list.push(k * step);
    return list.map((x) => Number(x.toPrecision(12)));
  }
  const densities = ({ edges, counts }) => {
    const total = counts.reduce((a, b) => a + b, 0);
    return counts.map((count, k) => count / (total * (edges[k + 1] - edges[k])));
  };

  function histogram(name, now, base) {
    const [width, height, left, top, bottom] = [300, 150, 8, 6, 38];
    const image = element("svg", { viewBox: `0 0 ${width} ${height}`, role: "img" });
    const told = `${name}: mean ${number(now.mean)}, sigma ${number(now.sigma)} ${now.unit}, ` +
      `from ${number(now.min)} to ${number(now.max)}`;
    image.setAttribute("aria-label", told);
    const both = [now, base].filter((one) => one && one.edges.length);
    if (!now.edges.length) {
      const text = now.n ? `constant ${number(now.mean, 6)} ${now.unit}` : "no case has it";
      image.append(element("text", { x: width / 2, y: height / 2, "text-anchor": "middle",
        "font-size": 13 }, text));
      return image;
    }
    let low = Math.min(...both.map((one) => one.edges[0]));
    let high = Math.max(...both.map((one) => one.edges.at(-1)));
    const near = now.bounds.filter((b) => b >= low - (high - low) && b <= high + (high - low));
    low = Math.min(low, ...near);
    high = Math.max(high, ...near);
    [low, high] = [low - 0.02 * (high - low), high + 0.02 * (high - low)];
    const x = (value) => left + (width - 2 * left) * (value - low) / (high - low);
    const most = Math.max(...both.flatMap(densities));
    const y = (value) => height - bottom - (height - bottom - top) * value / most;
    const outline = (one) => densities(one).map((value, k) =>
      `L${x(one.edges[k]).toFixed(1)} ${y(value).toFixed(1)} ` +
      `L${x(one.edges[k + 1]).toFixed(1)} ${y(value).toFixed(1)}`).join(" ");
    const from = (one) => `M${x(one.edges[0]).toFixed(1)} ${y(0)} `;
    const end = (one) => ` L${x(one.edges.at(-1)).toFixed(1)} ${y(0)}`;
    image.append(element("path", { d: from(now) + outline(now) + end(now) + "Z", fill: COLOURS.bars }));
    if (base && base.edges.length) {
      image.append(element("path", { d: from(base) + outline(base) + end(base), fill: "none",
        stroke: COLOURS.base, "stroke-width": 0.8 }));
    }
    for (const bound of near) {
      image.append(element("line", { x1: x(bound), x2: x(bound), y1: top, y2: y(0),
        stroke: COLOURS.bound, "stroke-width": 2.2 }));
    }
    image.append(element("line", { x1: left, x2: width - left, y1: y(0), y2: y(0),
      stroke: "#1b1f23", "stroke-width": 0.8 }));
    const middle = y(0) + 8;  // of box and whiskers
    const line = (x1, x2, y1, y2, w) => image.append(element("line",
      { x1, x2, y1, y2, stroke: COLOURS.box, "stroke-width": w }));
    if (now.p1 !== null) line(x(now.p1), x(now.p99), middle, middle, 1.2);
    if (now.p5 !== null) {
      image.append(element("rect", { x: x(now.p5), y: middle - 4, height: 8,
        width: Math.max(0.5, x(now.p95) - x(now.p5)), fill: "#fff", stroke: COLOURS.box }));
    }
    if (now.p50 !== null) line(x(now.p50), x(now.p50), middle - 4, middle + 4, 2.2);
    for (const value of ticks(low, high, 4)) {
      image.append(element("text", { x: x(value), y: height - 8, "text-anchor": "middle",
        "font-size": 11 }, number(value, 6)));
    }
    return image;
  }

  // Cells of verdicts with the percentage of violating cases; `at` is the design of the sliders.
  function map({ axes, requirements }, name, at) {
    const { verdicts, fractions } = requirements[name], [across, up] = axes;
    const [width, height, left, bottom] = [640, 360, 90, 44];
    const image = element("svg", { viewBox: `0 0 ${width} ${height}`, role: "img" });
    image.setAttribute("aria-label", `Verdicts on ${name} over ${across.key} and ${up.key}`);
    const [columns, rows] = [across.values.length, up.values.length];
    const [w, h] = [(width - left - 8) / columns, (height - bottom - 8) / rows];
    verdicts.forEach((line, j) => line.forEach((verdict, k) => {
      const x = left + k * w, y = height - bottom - (j + 1) * h;
      const fill = COLOURS[verdict] || COLOURS.other;
      image.append(element("rect", { x, y, width: w - 1, height: h - 1, fill }));
      const percent = 100 * fractions[j][k];
      image.append(element("text", { x: x + w / 2, y: y + h / 2 + 4, "text-anchor": "middle",
        "font-size": 11 }, percent ? `${number(percent, 2)} %` : "0"));
    }));
    const place = (axis, value) => (value - axis.values[0]) / (axis.values.at(-1) - axis.values[0]);
    const [x, y] = [left + w * (0.5 + (columns - 1) * place(across, at[0])),
      height - bottom - h * (0.5 + (rows - 1) * place(up, at[1]))];
    image.append(element("path", { d: `M${x - 9} ${y}h18M${x} ${y - 9}v18`, stroke: "#000",
      "stroke-width": 2 }));
    const text = (value, x, y, anchor) => image.append(element("text",
      { x, y, "text-anchor": anchor, "font-size": 12 }, value));
    for (let k = 0; k < columns; k += 3) {
      text(number(across.values[k]), left + (k + 0.5) * w, height - bottom + 14, "middle");
    }
    for (let j = 0; j < rows; j += 2) {
      text(number(up.values[j]), left - 6, height - bottom - (j + 0.5) * h + 4, "end");
    }
    text(across.key, left + (width - left) / 2, height - 6, "middle");
    image.append(element("text", { transform: `translate(14 ${(height - bottom) / 2}) rotate(-90)`,
      "text-anchor": "middle", "font-size": 12 }, up.key));
    return image;
  }
  return { histogram, map, number };
})();
