"use strict";
// Plays one controller's trial, or several from one start in step. `root` holds the controls and, for each of `sides`
// (element with parts, data), what is drawn; keys are taken from `keys`.
const replayPlayer = (root, sides, keys) => {
  const el = (part) => root.querySelector(`[data-part="${part}"]`);
  const timesteps = Math.max(...sides.map(([, data]) => data.timesteps));
  const views = sides.map(([side, data]) => replayDrawing(data, side, timesteps));
  const MS_PER_TIMESTEP = 32;
  let row = 0, playing = false, last = 0, owed = 0;

  const draw = () => {
    for (const view of views) {
      view.draw(row);
      (view.el("status") || el("status")).textContent = view.status(row);
    }
    el("slider").value = row;
  };
  const refresh = () => { views.forEach((view) => view.refresh()); draw(); };

  const go = (to) => { row = Math.min(timesteps, Math.max(0, Math.round(to))); draw(); };
  const setPlaying = (on) => {
    if (on && row === timesteps) row = 0;
    playing = on;
    el("play").textContent = on ? "Pause" : "Play";
    last = performance.now();
    owed = 0;
    if (on) requestAnimationFrame(tick);
  };
  const tick = (now) => {
    if (!playing) return;
    owed += Math.max(0, now - last) * el("speed").value / MS_PER_TIMESTEP;
    last = now;
    const steps = Math.floor(owed);
    owed -= steps;
    if (steps) go(row + steps);
    if (row === timesteps) setPlaying(false);
    else requestAnimationFrame(tick);
  };
  const step = (by) => { setPlaying(false); go(row + by); };

  el("play").addEventListener("click", () => setPlaying(!playing));
  el("back").addEventListener("click", () => step(-1));
  el("forward").addEventListener("click", () => step(1));
  el("slider").addEventListener("input", (event) => { setPlaying(false); go(+event.target.value); });
  keys.addEventListener("keydown", (event) => {
    if (event.target.tagName === "SELECT" || event.ctrlKey || event.altKey || event.metaKey) return;
    const by = event.shiftKey ? 10 : 1;
    if (event.key === " ") {
      if (event.target.tagName === "BUTTON") return;
      setPlaying(!playing);
    } else if (event.key === "ArrowLeft") step(-by);
    else if (event.key === "ArrowRight") step(by);
    else if (event.key === "Home") step(-timesteps);
    else if (event.key === "End") step(timesteps);
    else return;
    event.preventDefault();
  });

  views.forEach((view) => {
    const { names, steps } = view.data, raster = view.el("raster"), bars = view.el("weights");
    const rasterAt = (event) => {
      const box = raster.getBoundingClientRect(), { width, left, pitch, count } = view.rasterPlace();
      const t = Math.floor((event.clientX - box.left - left) / (width - left) * timesteps);
      return [Math.min(view.data.timesteps - 1, Math.max(0, t)),
        Math.min(count - 1, Math.floor((event.clientY - box.top) / pitch))];
    };
    raster.addEventListener("click", (event) => { setPlaying(false); go(rasterAt(event)[0]); });
    raster.addEventListener("pointermove", (event) => {
      const [t, n] = rasterAt(event);
      if (names.neurons[n] !== undefined)
        view.el("raster-note").textContent = `${names.neurons[n]}, timestep ${t}: ${view.spikes.at(t, n)} of ${steps}`;
    });
    for (const kind of ["pointermove", "click"]) bars.addEventListener(kind, (event) => {
      const box = bars.getBoundingClientRect();
      const pitch = (box.width - view.WEIGHT_LEFT) / Math.max(1, view.weights.columns);
      const s = Math.floor((event.clientX - box.left - view.WEIGHT_LEFT) / pitch);
      if (names.synapses[s] === undefined) return;
      const now = view.weights.at(Math.min(row, view.data.timesteps - 1), s).toFixed(3), [low, high] = view.ranges[s];
      view.el("weights-note").textContent =
        `${names.synapses[s]}, ${names.kinds[s]}: ${now} now, ${low.toFixed(3)} to ${high.toFixed(3)} over the trial`;
    });
  });

  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", refresh);
  window.addEventListener("resize", refresh);
  // "#t=300" in the address opens the replay there.
  const asked = /^#t=(\d+)$/.exec(location.hash);
  if (asked) row = Math.min(timesteps, +asked[1]);
  refresh();
};
