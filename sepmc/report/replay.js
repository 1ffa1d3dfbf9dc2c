// Three-dimensional replays of cases, drawn on a plain canvas: faces of solids from back to front.
// Data: `sepmc/report/replay_data.py`. Axes: x forward, y up, z right; metres.
"use strict";
const sepmcReplays = (() => {
  const $ = (id) => document.getElementById(id);
  let cases = [], replays = [], nominal;
  if (!$("replay")) return { set() {}, has: () => false, open() {} };

  const SIDES = 32;  // of a circle
  const COLOURS = { thrust: "#D55E00", constraint: "#000000", spring: "#009E73", load: "#6a51a3" };
  const WORDS = { thrust: "thrust of", constraint: "constraint force of", spring: "force of spring",
    load: "load" };
  const ARROW = 0.25;  // length of the largest arrow / radius of the view
  const LEAST = 1e-4;  // smallest force with an arrow / largest one
  const VIEWS = {  // yaw and pitch of the camera, rad
    "3-D": [-0.6, 0.35], side: [0, 0], top: [0, Math.PI / 2], rear: [-Math.PI / 2, 0],
  };
  const canvas = $("canvas"), slider = $("slider"), play = $("play"), select = $("case"),
    follow = $("follow"), ghost = $("ghost"), context = canvas.getContext("2d");
  let shown = null, row = 0, [yaw, pitch] = VIEWS["3-D"], zoom = 1, pan = [0, 0];
  let started = null, waiting = false;

  // Vectors, and rotations by scalar-first quaternions as matrices of three rows.
  const at = (list, k, size) => list.slice(size * k, size * k + size);
  const add = (a, b) => a.map((x, k) => x + b[k]);
  const minus = (a, b) => a.map((x, k) => x - b[k]);
  const times = (s, a) => a.map((x) => s * x);
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [0, 1, 2].map((k) => {
    const [m, n] = [(k + 1) % 3, (k + 2) % 3];
    return a[m] * b[n] - a[n] * b[m];
  });
  const size = (a) => Math.sqrt(dot(a, a));
  const turn = (m, a) => m.map((line) => dot(line, a));
  const back = (m, a) => [0, 1, 2].map((k) => m[0][k] * a[0] + m[1][k] * a[1] + m[2][k] * a[2]);
  const matrix = ([w, x, y, z]) => [
    [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]];
  const pose = (one, k, body) =>
    [at(one.bodies[body].at, k, 3), matrix(at(one.bodies[body].turn, k, 4))];
  const placed = ([p, m], arm) => add(p, turn(m, arm));

  // Faces, edges and points of a part in body axes.
  function shape(part) {
    if (part.points) return { faces: [], edges: [], points: part.points };
    if (Math.max(...part.radii) === 0) {
      return { faces: [], edges: [[part.start, part.end]], points: [] };
    }
    const [from, to] = part.sector || [0, 2 * Math.PI];
    const count = Math.max(2, Math.ceil(SIDES * (to - from) / (2 * Math.PI)));
    const rings = [part.start, part.end].map((centre, end) =>
      Array.from({ length: count + 1 }, (_, k) => {
        const angle = from + (to - from) * k / count, r = part.radii[end];
        return add(centre, [0, -r * Math.sin(angle), r * Math.cos(angle)]);
      }));
    const faces = [], edges = [];
    for (let k = 0; k < count; k++) {
      faces.push([rings[0][k], rings[0][k + 1], rings[1][k + 1], rings[1][k]]);
      for (const ring of rings) edges.push([ring[k], ring[k + 1]]);
    }
    if (part.sector) for (const k of [0, count]) edges.push([rings[0][k], rings[1][k]]);
    if (!part.wall) faces.push(...rings.map((ring) => ring.slice(0, count)));
    return { faces, edges, points: [], wall: part.wall };
  }

  // Outlines, largest forces and reach of a case.
  function prepare(one) {
    for (const body of one.bodies) {
      body.shapes = body.parts.map(shape);
      const spokes = body.spokes.map((end) => [[0, 0, 0], end]);
      body.shapes.push({ faces: [], points: [], edges: spokes });
      const points = body.shapes.flatMap(
        (s) => [...s.faces.flat(), ...s.edges.flat(), ...s.points]);
      body.reach = Math.max(0.01, ...points.map(size));
      const ends = [0, 1, 2].map((k) => [Math.min(0, ...points.map((p) => p[k])),
        Math.max(0, ...points.map((p) => p[k]))]);
      body.corners = ends[0].flatMap((x) => ends[1].flatMap((y) => ends[2].map((z) => [x, y, z])));
    }
    one.largest = {};
    for (const arrow of one.arrows) {
      for (let k = 0; k < one.time.length; k++) {
        one.largest[arrow.kind] =
          Math.max(one.largest[arrow.kind] || 0, size(at(arrow.force, k, 3)));
      }
    }
    let reach = 0;  // of the farthest body so far
    one.reach = one.time.map((_, k) => {
      for (const body of one.bodies) reach = Math.max(reach, size(at(body.at, k, 3)) + body.reach);
      return reach;
    });
  }

  const rowAt = (one, time) => {
    const k = one.time.findIndex((t) => t > time);
    return k < 0 ? one.time.length - 1 : Math.max(0, k - 1);
  };
  // From the axes of a case to those of the camera: right, up, toward the viewer.
  function camera(one, k) {
    const [sy, cy, sp, cp] = [Math.sin(yaw), Math.cos(yaw), Math.sin(pitch), Math.cos(pitch)];
    const body = Number(follow.value);
    const [origin, axes] = body >= 0 ? pose(one, k, body) : [[0, 0, 0], null];
    return (point) => {
      let [x, y, z] = minus(point, origin);
      if (axes) [x, y, z] = back(axes, [x, y, z]);
      const toward = sy * x - cy * z;
      return [-cy * x - sy * z, cp * y - sp * toward, cp * toward + sp * y];
    };
  }

  // Middle of the view, and pixels per metre: all bodies since the start fit into the view, which
  // widens as they separate.
  function frame() {
    const [low, high] = [[0, 0], [0.01, 0.01]];
    for (let k = row; k >= 0; k = k > 0 ? Math.max(0, k - 10) : -1) {
      const seen = camera(shown, k);
      shown.bodies.forEach((body, number) => {
        const own = pose(shown, k, number);
        for (const corner of body.corners) {
          const point = seen(placed(own, corner));
          for (const axis of [0, 1]) {
            low[axis] = Math.min(low[axis], point[axis]);
            high[axis] = Math.max(high[axis], point[axis]);
          }
        }
      });
    }
    const middle = times(0.5, add(low, high)), [right, up] = minus(high, low);
    const scale = 0.85 * zoom * Math.min(canvas.clientWidth / right, canvas.clientHeight / up);
    return { middle, scale };
  }

  function draw() {
    waiting = false;
    const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth;
    const height = canvas.clientHeight;
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.lineJoin = context.lineCap = "round";
    const { middle, scale } = frame(), [right, up] = add(middle, pan);
    const flat = ([x, y]) => [width / 2 + scale * (x - right), height / 2 - scale * (y - up)];
    const path = (points, closed) => {
      context.beginPath();
      points.forEach((point, k) => context[k ? "lineTo" : "moveTo"](...flat(point)));
      if (closed) context.closePath();
    };
    const items = [], marks = [], seen = camera(shown, row);  // drawn by depth
    shown.bodies.forEach((body, number) => {
      const own = pose(shown, row, number), map = (p) => seen(placed(own, p));
      marks.push([seen(own[0]), body.edge]);
      for (const { faces, edges, points, wall } of body.shapes) {
        for (const face of faces) {
          const corners = face.map(map);
          const depth = corners.reduce((d, c) => d + c[2], 0) / corners.length;
          const [a, b] = [minus(corners[2], corners[0]), minus(corners.at(-1), corners[1])];
          const normal = cross(a, b);
          const light = Math.abs(dot(normal, [0.3, 0.6, 0.75])) / (size(normal) || 1);
          items.push([depth, () => {
            path(corners, true);
            context.globalAlpha = wall ? 0.35 : 1;
            context.fillStyle = context.strokeStyle = shade(body.tint, 0.72 + 0.28 * light);
            context.lineWidth = 0.7;  // hides the seam between faces
            context.fill();
            if (!wall) context.stroke();
            context.globalAlpha = 1;
          }]);
        }
        for (const edge of edges) {
          const ends = edge.map(map);
          const lift = faces.length ? 0.02 * body.reach : 0;
          items.push([(ends[0][2] + ends[1][2]) / 2 + lift, () => {
            path(ends);
            context.strokeStyle = body.edge;
            context.lineWidth = faces.length ? 1 : 2;
            context.stroke();
          }]);
        }
        for (const point of points.map(map)) {
          items.push([point[2], () => dotAt(point, 3, body.edge)]);
        }
      }
    });
    items.sort((a, b) => a[0] - b[0]).forEach(([, paint]) => paint());

    for (const [centre, colour] of marks) dotAt(centre, 4, colour);

    function dotAt(point, radius, colour) {
      context.beginPath();
      context.arc(...flat(point), radius, 0, 7);
      context.fillStyle = colour;
      context.fill();
    }
    if (nominal && ghost.checked) {
      const k = rowAt(nominal, shown.time[row]), own = camera(nominal, k);
      context.strokeStyle = "#5b6670";
      context.lineWidth = 0.9;
      context.setLineDash([5, 3]);
      nominal.bodies.forEach((body, number) => {
        const pose0 = pose(nominal, k, number);
        for (const { faces, edges } of body.shapes) {
          for (const edge of edges) path(edge.map((p) => own(placed(pose0, p)))), context.stroke();
          for (let s = 0; s < faces.length; s += 8) {
            path([faces[s][0], faces[s].at(-1)].map((p) => own(placed(pose0, p))));
            if (faces[s].length === 4) context.stroke();
          }
        }
      });
      context.setLineDash([]);
    }
    for (const arrow of shown.arrows) {
      const force = at(arrow.force, row, 3), own = pose(shown, row, arrow.body);
      const start = placed(own, arrow.at);
      if (arrow.kind === "constraint") {
        dotAt(seen(start), isActive(arrow) ? 4 : 2, COLOURS.constraint);
      }
      if (size(force) < LEAST * shown.largest[arrow.kind] || !size(force)) continue;
      // by the square root, so that small forces are seen beside large ones
      const length = ARROW * shown.reach[row] / Math.sqrt(size(force) * shown.largest[arrow.kind]);
      arrowTo(flat(seen(start)), flat(seen(add(start, times(length, force)))), COLOURS[arrow.kind]);
    }
    for (const { line } of shown.distances) {
      const ends = at(line, row, 6);
      if (ends[0] === null) continue;
      const points = [ends.slice(0, 3), ends.slice(3)].map(seen);
      path(points);
      context.strokeStyle = "#b0007a";
      context.lineWidth = 2.5;
      context.stroke();
      points.forEach((point) => dotAt(point, 3, "#b0007a"));
    }
    scaleBar(scale, height);
  }

  const isActive = (arrow) => arrow.until === null || shown.time[row] < arrow.until;
  const shade = (colour, light) => "#" + [1, 3, 5].map((k) => Math.round(
    parseInt(colour.slice(k, k + 2), 16) * light).toString(16).padStart(2, "0")).join("");

  function arrowTo([x0, y0], [x1, y1], colour) {
    const angle = Math.atan2(y1 - y0, x1 - x0), head = 9;
    context.strokeStyle = context.fillStyle = colour;
    context.lineWidth = 2;
    context.beginPath();
    context.moveTo(x0, y0);
    context.lineTo(x1, y1);
    context.stroke();
    context.beginPath();
    context.moveTo(x1, y1);
    for (const side of [-0.4, 0.4]) {
      context.lineTo(x1 - head * Math.cos(angle + side), y1 - head * Math.sin(angle + side));
    }
    context.fill();
  }

  function scaleBar(scale, height) {
    const metres = 10 ** Math.floor(Math.log10(150 / scale));
    const long = [5, 2, 1].map((k) => k * metres).find((m) => m * scale <= 150);
    context.strokeStyle = context.fillStyle = "#1b1f23";
    context.lineWidth = 2;
    context.beginPath();
    context.moveTo(14, height - 14);
    context.lineTo(14 + long * scale, height - 14);
    context.stroke();
    context.font = "12px sans-serif";
    context.fillText(long >= 1 ? `${long} m` : `${Number((1000 * long).toPrecision(1))} mm`,
      14, height - 20);
  }

  function showValues() {
    const time = `${shown.time[row].toFixed(3)} s`, phase = shown.phases[shown.phase[row]];
    $("time").textContent = `${time}, ${phase}`;
    slider.setAttribute("aria-valuetext", `${time}, ${phase}`);
    slider.value = row;
    const lines = shown.distances.map(({ name, value }) => [`distance ${name}`,
      value[row] === null ? "not defined here" : `${value[row].toFixed(1)} mm`]);
    for (const arrow of shown.arrows) {
      const force = size(at(arrow.force, row, 3));
      lines.push([`${WORDS[arrow.kind]} ${arrow.name}`,
        isActive(arrow) ? `${force.toLocaleString("en", { maximumSignificantDigits: 4 })} N`
          : `${arrow.kind === "constraint" ? "released" : "ended"} at ${arrow.until.toFixed(3)} s`]);
    }
    $("values").replaceChildren(...lines.map(([name, text]) => {
      const line = document.createElement("tr");
      line.append(document.createElement("th"), document.createElement("td"));
      line.cells[0].scope = "row";
      [line.cells[0].textContent, line.cells[1].textContent] = [name, text];
      return line;
    }));
  }

  function show(k) {
    row = Math.max(0, Math.min(shown.time.length - 1, k));
    showValues();
    redraw();
  }
  function redraw() {
    if (!shown) return;
    if (!waiting) requestAnimationFrame(draw);
    waiting = true;
  }
  function load(one) {
    shown = one;
    select.value = one.number;
    slider.max = one.time.length - 1;
    const options = [["-1", "the common centre of mass"], ...one.bodies.map((b, k) => [k, b.name])];
    const before = follow.value || "-1";
    follow.replaceChildren(...options.map(([value, name]) => new Option(name, value)));
    follow.value = before;
    $("bodies").replaceChildren(...one.bodies.map((body) => {
      const item = document.createElement("li"), swatch = document.createElement("span");
      swatch.style.background = body.tint;
      swatch.style.borderColor = body.edge;
      item.append(swatch, body.name);
      return item;
    }));
    canvas.setAttribute("aria-label", `Three-dimensional replay of ${one.title}. ` +
      "Arrow keys turn the view, plus and minus zoom, Home resets it.");
    show(Math.min(row, one.time.length - 1));
  }
  function open(number) {
    row = 0;
    load(byNumber(number));
    $("replay").scrollIntoView({ block: "start" });
    slider.focus({ preventScroll: true });
  }

  // The whole case takes eight seconds.
  function step(now) {
    if (started === null) return;
    const end = shown.time.at(-1), time = started.time + (now - started.now) / 8000 * end;
    show(rowAt(shown, time));
    if (time >= end) stop();
    else requestAnimationFrame(step);
  }
  function stop() {
    started = null;
    play.textContent = "Play";
  }
  play.onclick = () => {
    if (started !== null) return stop();
    if (row >= shown.time.length - 1) show(0);
    started = { now: performance.now(), time: shown.time[row] };
    play.textContent = "Pause";
    requestAnimationFrame(step);
  };
  slider.oninput = () => { stop(); show(Number(slider.value)); };
  const byNumber = (number) => replays.find((one) => one.number === number);
  select.onchange = () => { stop(); load(byNumber(Number(select.value))); };
  follow.onchange = ghost.onchange = redraw;
  const view = (angles) => { [yaw, pitch] = angles; zoom = 1; pan = [0, 0]; redraw(); };
  for (const button of document.querySelectorAll("[data-view]")) {
    button.onclick = () => view(VIEWS[button.dataset.view]);
  }
  // Center the line of least distance, 100 pixels long where it is seen from the side.
  $("nearest").onclick = () => {
    const known = shown.distances.filter(({ line }) => line[6 * row] !== null);
    if (!known.length) return;
    const { line } = known.reduce((a, b) => (b.value[row] < a.value[row] ? b : a));
    const ends = at(line, row, 6);
    const [a, b] = [ends.slice(0, 3), ends.slice(3)].map(camera(shown, row));
    zoom = 1;
    const { middle, scale } = frame();
    pan = minus(times(0.5, add(a, b)), [...middle, 0]);
    zoom = Math.min(1e4, Math.max(1, 100 / (scale * Math.max(size(minus(a, b)), 1e-4))));
    redraw();
  };
  const zoomBy = (factor) => { zoom = Math.min(1e4, Math.max(0.2, zoom * factor)); redraw(); };
  const turnBy = (right, up) => {
    yaw += right;
    pitch = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, pitch + up));
    redraw();
  };
  $("in").onclick = () => zoomBy(1.4);
  $("out").onclick = () => zoomBy(1 / 1.4);
  canvas.onwheel = (event) => { event.preventDefault(); zoomBy(Math.exp(-0.001 * event.deltaY)); };
  canvas.onpointerdown = (event) => canvas.setPointerCapture(event.pointerId);
  canvas.onpointermove = (event) => {
    if (!event.buttons) return;
    if (event.shiftKey || event.buttons === 2) {
      const { scale } = frame();
      pan = [pan[0] - event.movementX / scale, pan[1] + event.movementY / scale];
      redraw();
    } else turnBy(-0.008 * event.movementX, 0.008 * event.movementY);
  };
  canvas.oncontextmenu = (event) => event.preventDefault();
  canvas.onkeydown = (event) => {
    const act = {
      ArrowLeft: () => turnBy(0.1, 0), ArrowRight: () => turnBy(-0.1, 0),
      ArrowUp: () => turnBy(0, 0.1), ArrowDown: () => turnBy(0, -0.1),
      "+": () => zoomBy(1.2), "=": () => zoomBy(1.2), "-": () => zoomBy(1 / 1.2),
      Home: () => view(VIEWS["3-D"]),
    }[event.key];
    if (act) { event.preventDefault(); act(); }
  };
  new ResizeObserver(redraw).observe(canvas);

  // Show these cases; the nominal one has no number.
  function set(list) {
    stop();
    list.forEach(prepare);
    cases = list;
    nominal = cases.find((one) => one.number === null);
    replays = cases.filter((one) => one.number !== null);
    $("replay").hidden = !replays.length;
    select.replaceChildren(...replays.map((one) => new Option(one.title, one.number)));
    if (replays.length) load(replays[0]);
  }
  return { set, has: (number) => Boolean(byNumber(number)), open };
})();
