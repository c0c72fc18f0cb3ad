"use strict";
(() => {
  const el = (id) => document.getElementById(id);
  const data = JSON.parse(el("data").textContent);
  const { names, timesteps } = data;
  const view = replayDrawing(data);
  const MS_PER_TIMESTEP = 32;
  const bumped = new Set(data.bumps);
  const counted = (row) => data.extra.reduce((sum, [at, more]) => (at < row ? sum + more : sum), row);
  let row = 0, playing = false, last = 0, owed = 0;

  const drawStatus = () => {
    const t = Math.min(row, timesteps - 1);
    const what = row === timesteps ? "end" : names.actions[+data.actions[t]] + (bumped.has(row) ? ", bump" : "");
    el("status").textContent = `timestep ${row}/${timesteps}, counted ${counted(row)}: ${what}`;
    el("slider").value = row;
  };
  const draw = () => { view.draw(row); drawStatus(); };
  const refresh = () => { view.refresh(); draw(); };

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
  document.addEventListener("keydown", (event) => {
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

  const rasterAt = (event) => {
    const box = el("raster").getBoundingClientRect(), { width, left, pitch, count } = view.rasterPlace();
    const t = Math.floor((event.clientX - box.left - left) / (width - left) * timesteps);
    return [Math.min(timesteps - 1, Math.max(0, t)), Math.min(count - 1, Math.floor((event.clientY - box.top) / pitch))];
  };
  el("raster").addEventListener("click", (event) => { setPlaying(false); go(rasterAt(event)[0]); });
  el("raster").addEventListener("pointermove", (event) => {
    const [t, n] = rasterAt(event);
    if (names.neurons[n] !== undefined)
      el("raster-note").textContent = `${names.neurons[n]}, timestep ${t}: ${view.spikes.at(t, n)} of ${data.steps}`;
  });
  for (const kind of ["pointermove", "click"]) el("weights").addEventListener(kind, (event) => {
    const box = el("weights").getBoundingClientRect(), pitch = (box.width - view.WEIGHT_LEFT) / Math.max(1, view.weights.columns);
    const s = Math.floor((event.clientX - box.left - view.WEIGHT_LEFT) / pitch);
    if (names.synapses[s] === undefined) return;
    const now = view.weights.at(Math.min(row, timesteps - 1), s).toFixed(3), [low, high] = view.ranges[s];
    el("weights-note").textContent =
      `${names.synapses[s]}, ${names.kinds[s]}: ${now} now, ${low.toFixed(3)} to ${high.toFixed(3)} over the trial`;
  });

  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", refresh);
  window.addEventListener("resize", refresh);
  // "#t=300" in the address opens the replay there.
  const asked = /^#t=(\d+)$/.exec(location.hash);
  if (asked) row = Math.min(timesteps, +asked[1]);
  refresh();
})();
