"use strict";
// Draws one controller's trial at one row of its path into the parts of `root`; owns nothing but sizes and colours.
// The axis of time is `span` timesteps long, so that trials beside each other share it.
const replayDrawing = (data, root, span) => {
  const { arena, names, colours, timesteps } = data;
  const el = (part) => root.querySelector(`[data-part="${part}"]`);
  const unpack = ({ unit, size, columns, codes, inflated }) => {
    const view = new DataView((inflated || Uint8Array.from(atob(codes), (c) => c.charCodeAt(0))).buffer);
    const code = size === 1 ? (k) => view.getInt8(k) : (k) => view.getInt16(2 * k, true);
    const at = (row, column) => unit * code(row * columns + column);
    return { at, columns };
  };
  const path = unpack(data.path), sensors = unpack(data.sensors), outputs = unpack(data.outputs);
  const spikes = unpack(data.spikes), packed = unpack(data.weights);
  // Where a trial is long, weights stand in the file at every so many timesteps only.
  const weights = { columns: packed.columns, at: (t, s) => packed.at(Math.floor(t / data.stride), s) };

  const ranges = [];
  let lowest = 0, highest = 1;
  for (let s = 0; s < weights.columns; s++) {
    let low = Infinity, high = -Infinity;
    for (let t = 0; t < timesteps; t += data.stride) {
      low = Math.min(low, weights.at(t, s));
      high = Math.max(high, weights.at(t, s));
    }
    ranges.push([low, high]);
    lowest = Math.min(lowest, low);
    highest = Math.max(highest, high);
  }

  const theme = {};
  let rasterImage = null;

  const readTheme = () => {
    const style = getComputedStyle(document.documentElement);
    for (const key of ["paper", "panel", "ink", "soft", "line", "wall", "goal", "start", "pale", "lamp"])
      theme[key] = style.getPropertyValue("--" + key).trim();
  };
  const rgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));
  const mix = (from, to, share) => {
    const a = rgb(from), b = rgb(to), s = Math.min(1, Math.max(0, share));
    return a.map((v, i) => Math.round(v + s * (b[i] - v)));
  };
  const css = (c) => `rgb(${c[0]},${c[1]},${c[2]})`;

  // Sizes a canvas to its column, in device pixels, and returns a context in CSS pixels.
  const fit = (canvas, height) => {
    const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth;
    canvas.style.height = height + "px";
    const w = Math.round(width * ratio), h = Math.round(height * ratio);
    if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
    const g = canvas.getContext("2d");
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.clearRect(0, 0, width, height);
    g.font = "12px system-ui, sans-serif";
    return g;
  };

  const lens = (width, x, y, reach) => {
    const k = width / (2 * reach);
    return { k, x: (m) => k * (m - x + reach), y: (m) => k * (y + reach - m) };
  };
  const polygon = (g, at, points, fill) => {
    g.beginPath();
    points.forEach(([x, y]) => g.lineTo(at.x(x), at.y(y)));
    g.closePath();
    g.fillStyle = fill;
    g.fill();
  };
  const disc = (g, x, y, r, fill) => {
    g.beginPath();
    g.arc(x, y, r, 0, 2 * Math.PI);
    g.fillStyle = fill;
    g.fill();
    g.strokeStyle = theme.ink;
    g.lineWidth = 1;
    g.stroke();
  };
  const world = (g, at) => {
    arena.goals.forEach((goal) => polygon(g, at, goal, theme.goal));
    polygon(g, at, arena.start, theme.start);
    g.strokeStyle = theme.ink;
    g.lineWidth = 2;
    for (const [half, fill] of [[arena.half, null], [arena.box, theme.wall]]) {
      const box = [at.x(-half), at.y(half), 2 * half * at.k, 2 * half * at.k];
      if (fill) { g.fillStyle = fill; g.fillRect(...box); }
      g.strokeRect(...box);
    }
    disc(g, at.x(arena.lamp[0]), at.y(arena.lamp[1]), Math.max(5, 0.02 * at.k), theme.lamp);
  };
  const robot = (g, at, row, line) => {
    const t = Math.min(row, timesteps - 1);
    const [x, y, heading] = [0, 1, 2].map((c) => path.at(row, c));
    const cos = Math.cos(heading), sin = Math.sin(heading);
    const points = arena.points.map(([f, l]) => [x + cos * f - sin * l, y + sin * f + cos * l]);
    points.forEach(([px, py], i) => {
      const angle = heading + arena.bearings[i];
      g.beginPath();
      g.moveTo(at.x(px), at.y(py));
      g.lineTo(at.x(px + arena.range * Math.cos(angle)), at.y(py + arena.range * Math.sin(angle)));
      g.strokeStyle = css(mix(theme.pale, colours.ir, sensors.at(t, i)));
      g.lineWidth = line;
      g.stroke();
    });
    disc(g, at.x(x), at.y(y), arena.radius * at.k, theme.panel);
    g.beginPath();
    g.moveTo(at.x(x), at.y(y));
    g.lineTo(at.x(x + 0.75 * arena.radius * cos), at.y(y + 0.75 * arena.radius * sin));
    g.strokeStyle = theme.ink;
    g.lineWidth = line;
    g.stroke();
    points.forEach(([px, py], i) => disc(g, at.x(px), at.y(py), Math.max(2, 0.2 * arena.radius * at.k),
      css(mix(theme.pale, colours.light, sensors.at(t, 3 + i)))));
  };
  const bumped = new Set(data.bumps);
  const tint = (t) => (bumped.has(t) ? theme.soft : colours.actions[+data.actions[t]]);
  const trail = (g, at, from, to, colour, alpha) => {
    g.beginPath();
    for (let t = from; t < to; t++) {
      if (colour !== null && tint(t) !== colour) continue;
      g.moveTo(at.x(path.at(t, 0)), at.y(path.at(t, 1)));
      g.lineTo(at.x(path.at(t + 1, 0)), at.y(path.at(t + 1, 1)));
    }
    g.globalAlpha = alpha;
    g.strokeStyle = colour === null ? theme.soft : colour;
    g.lineWidth = colour === null ? 1 : 2.5;
    g.stroke();
    g.globalAlpha = 1;
  };

  const drawArena = (row) => {
    const canvas = el("arena"), width = canvas.clientWidth;
    const g = fit(canvas, width), at = lens(width, 0, 0, 1.025 * arena.half);
    world(g, at);
    g.fillStyle = theme.soft;
    const half = arena.half, inset = 0.12 * half;
    g.textAlign = "left";
    g.fillText("start", at.x(-half) + 8, at.y(-half) - 8);
    arena.goals.forEach(([[x]], i) => {
      g.textAlign = x > 0 ? "right" : "left";
      const text = arena.goals.length > 1 ? "goal " + (i + 1) : "goal";
      g.fillText(text, at.x(x - Math.sign(x) * inset), at.y(half) + 18);
    });
    trail(g, at, row, timesteps, null, 0.5);
    [...colours.actions, theme.soft].forEach((colour) => trail(g, at, 0, row, colour, 1));
    g.strokeStyle = theme.ink;
    g.lineWidth = 2;
    for (const t of data.bumps) {
      if (t >= row) break;
      const x = at.x(path.at(t, 0)), y = at.y(path.at(t, 1));
      g.beginPath();
      g.moveTo(x - 4, y - 4); g.lineTo(x + 4, y + 4);
      g.moveTo(x - 4, y + 4); g.lineTo(x + 4, y - 4);
      g.stroke();
    }
    robot(g, at, row, 2);
  };

  const drawRobot = (row) => {
    const canvas = el("robot");
    if (!canvas) return;
    const width = canvas.clientWidth, g = fit(canvas, width);
    const at = lens(width, path.at(row, 0), path.at(row, 1), 3.6 * arena.radius);
    g.fillStyle = theme.paper;
    g.fillRect(0, 0, width, width);
    world(g, at);
    robot(g, at, row, 4);
    g.strokeStyle = theme.line;
    g.lineWidth = 2;
    g.strokeRect(1, 1, width - 2, width - 2);
  };

  const bars = [];
  const addSignal = (name, colour) => {
    const term = document.createElement("dt"), bar = document.createElement("dd"), value = document.createElement("dd");
    const fill = document.createElement("i");
    term.textContent = name;
    bar.className = "bar";
    value.className = "value";
    fill.style.background = colour;
    bar.append(fill);
    el("signals").append(term, bar, value);
    bars.push([fill, value]);
  };
  names.sensors.forEach((name, i) => addSignal(name, i < 3 ? colours.ir : colours.light));
  names.outputs.forEach((name) => addSignal(name, colours.actions[0]));
  const drawSignals = (row) => {
    const t = Math.min(row, timesteps - 1);
    bars.forEach(([fill, value], i) => {
      const v = i < 6 ? sensors.at(t, i) : outputs.at(t, i - 6);
      fill.style.width = (100 * Math.min(1, i < 6 ? v : v / data.steps)) + "%";
      value.textContent = i < 6 ? v.toFixed(2) : v + "/" + data.steps;
    });
  };

  const rasterPlace = () => {
    const width = el("raster").clientWidth, count = Math.max(1, names.neurons.length);
    const pitch = Math.max(4, Math.min(13, 330 / count));
    return { width, count, pitch, left: Math.min(76, 0.22 * width), height: pitch * count };
  };
  // One column per pixel, the mean of the timesteps that fall on it, so that nothing is skipped.
  const buildRaster = () => {
    const { width, left } = rasterPlace(), shown = (width - left) * timesteps / span;
    const columns = Math.max(1, Math.round(Math.min(timesteps, shown)));
    const rows = Math.max(1, spikes.columns);
    rasterImage = document.createElement("canvas");
    rasterImage.width = columns;
    rasterImage.height = rows;
    const g = rasterImage.getContext("2d"), image = g.createImageData(columns, rows);
    for (let n = 0; n < rows; n++) for (let c = 0; c < columns; c++) {
      const first = Math.floor(c * timesteps / columns), end = Math.floor((c + 1) * timesteps / columns);
      let sum = 0;
      if (spikes.columns) for (let t = first; t < end; t++) sum += spikes.at(t, n);
      const colour = mix(theme.panel, theme.ink, sum / (end - first) / data.steps);
      image.data.set([...colour, 255], 4 * (n * columns + c));
    }
    g.putImageData(image, 0, 0);
  };
  const drawRaster = (row) => {
    const { width, count, pitch, left, height } = rasterPlace(), g = fit(el("raster"), height + 18);
    g.imageSmoothingEnabled = false;
    g.drawImage(rasterImage, left, 0, (width - left) * timesteps / span, height);
    g.fillStyle = theme.soft;
    g.font = Math.min(11, pitch - 1) + "px system-ui, sans-serif";
    g.textAlign = "right";
    g.textBaseline = "middle";
    if (pitch >= 8) names.neurons.forEach((name, n) => g.fillText(name, left - 5, (n + 0.5) * pitch, left - 6));
    g.strokeStyle = theme.line;
    g.lineWidth = 1;
    for (const n of [6, count - 2]) if (n > 0 && n < count) {
      g.beginPath();
      g.moveTo(0, n * pitch);
      g.lineTo(width, n * pitch);
      g.stroke();
    }
    g.font = "11px system-ui, sans-serif";
    for (const share of [0, 0.5, 1]) {
      g.textAlign = share === 0 ? "left" : share === 1 ? "right" : "center";
      g.fillText(Math.round(share * span) + "", left + share * (width - left), height + 10);
    }
    const x = left + (width - left) * Math.min(row + 0.5, timesteps) / span;
    g.strokeStyle = colours.ir;
    g.lineWidth = 2;
    g.beginPath();
    g.moveTo(x, 0);
    g.lineTo(x, height + 3);
    g.stroke();
  };

  const WEIGHT_HEIGHT = 150, WEIGHT_LEFT = 30;
  const drawWeights = (row) => {
    const canvas = el("weights"), width = canvas.clientWidth, g = fit(canvas, WEIGHT_HEIGHT);
    const t = Math.min(row, timesteps - 1), y = (w) => 8 + (WEIGHT_HEIGHT - 16) * (highest - w) / (highest - lowest);
    g.textAlign = "right";
    g.textBaseline = "middle";
    g.lineWidth = 1;
    for (const w of [0, 0.5, 1]) {
      g.fillStyle = theme.soft;
      g.fillText(w.toString(), WEIGHT_LEFT - 6, y(w));
      g.strokeStyle = theme.line;
      g.beginPath();
      g.moveTo(WEIGHT_LEFT, y(w));
      g.lineTo(width, y(w));
      g.stroke();
    }
    const pitch = (width - WEIGHT_LEFT) / Math.max(1, weights.columns), thick = Math.max(1, Math.min(24, 0.8 * pitch));
    for (let s = 0; s < weights.columns; s++) {
      const x = WEIGHT_LEFT + (s + 0.5) * pitch - thick / 2, now = weights.at(t, s), [low, high] = ranges[s];
      g.fillStyle = colours.kinds[names.kinds[s]];
      g.globalAlpha = 0.3;
      g.fillRect(x, y(high), thick, Math.max(1, y(low) - y(high)));
      g.globalAlpha = 1;
      g.fillRect(x + 0.2 * thick, Math.min(y(0), y(now)), 0.6 * thick, Math.max(1, Math.abs(y(now) - y(0))));
    }
    if (!weights.columns) { g.textAlign = "center"; g.fillText("no synapses", width / 2, WEIGHT_HEIGHT / 2); }
  };

  const draw = (wanted) => {
    const row = Math.min(wanted, timesteps);
    for (const part of [drawArena, drawRobot, drawSignals, drawRaster, drawWeights]) part(row);
  };
  const refresh = () => { readTheme(); buildRaster(); };
  // What happens in a row, in words.
  const status = (wanted) => {
    const row = Math.min(wanted, timesteps), t = Math.min(row, timesteps - 1);
    const counted = data.extra.reduce((sum, [at, more]) => (at < row ? sum + more : sum), row);
    const what = row === timesteps ? "end" : names.actions[+data.actions[t]] + (bumped.has(row) ? ", bump" : "");
    return `timestep ${row}/${timesteps}, counted ${counted}: ${what}`;
  };
  return { data, draw, refresh, rasterPlace, spikes, weights, ranges, WEIGHT_LEFT, status, el };
};
