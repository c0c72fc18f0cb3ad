"use strict";
// What moves in the report: tables that sort, crossbars that tell their values, the replay.
(() => {
  const data = (id) => JSON.parse(document.getElementById(id).textContent);

  const key = (group, column) => {
    const cell = (group.tagName === "TR" ? group : group.rows[0]).cells[column];
    const text = cell.dataset.key ?? cell.textContent.trim(), number = Number(text);
    return text === "" ? null : Number.isNaN(number) ? text : number;
  };
  // What is empty stands last whichever way; numbers come before words.
  const compare = (a, b, down) => {
    if (a === null || b === null) return (a === null) - (b === null);
    if (typeof a !== typeof b) return typeof a === "number" ? -1 : 1;
    return (down ? -1 : 1) * (typeof a === "number" ? a - b : a.localeCompare(b));
  };
  for (const table of document.querySelectorAll("table.sortable")) {
    const headings = [...table.tHead.rows[0].cells];
    headings.forEach((heading, column) => heading.querySelector("[data-sort]")?.addEventListener("click", () => {
      const down = heading.getAttribute("aria-sort") === "ascending";
      headings.forEach((other) => other.removeAttribute("aria-sort"));
      heading.setAttribute("aria-sort", down ? "descending" : "ascending");
      // A figure is a group of two rows; elsewhere each row is one.
      const groups = table.tBodies.length > 1 ? [...table.tBodies] : [...table.tBodies[0].rows];
      const parent = table.tBodies.length > 1 ? table : table.tBodies[0];
      groups.sort((a, b) => compare(key(a, column), key(b, column), down)).forEach((group) => parent.append(group));
    }));
  }

  const maps = data("maps"), tip = document.getElementById("tip");
  const SVG = "http://www.w3.org/2000/svg";
  let marker = null;
  const hide = () => { tip.hidden = true; marker?.remove(); marker = null; };
  const show = (svg, map, [row, column, title, values], at) => {
    const [x0, y0, dx, dy] = svg.dataset.frame.split(" ").map(Number);
    hide();
    marker = document.createElementNS(SVG, "rect");
    const box = { x: x0 + (map.x[column] - 0.5) * dx, y: y0 + (row - 0.5) * dy, width: dx, height: dy };
    for (const [name, value] of Object.entries(box)) marker.setAttribute(name, value);
    marker.setAttribute("class", "marker");
    svg.append(marker);
    const head = document.createElement("b"), list = document.createElement("dl");
    head.textContent = title;
    values.forEach((value, k) => {
      const term = document.createElement("dt"), text = document.createElement("dd");
      term.textContent = map.keys[k];
      text.textContent = value;
      list.append(term, text);
    });
    tip.replaceChildren(head, ...(values.length ? [list] : []));
    tip.hidden = false;
    const cell = marker.getBoundingClientRect(), size = tip.getBoundingClientRect();
    const x = at ? at.clientX + 14 : cell.right + 8, y = at ? at.clientY + 14 : cell.bottom + 8;
    tip.style.left = Math.max(4, Math.min(x, document.documentElement.clientWidth - size.width - 4)) + "px";
    const above = (at ? at.clientY : cell.top) - size.height - 8;
    tip.style.top = Math.max(4, y + size.height > window.innerHeight ? above : y) + "px";
  };
  for (const svg of document.querySelectorAll("svg[data-map]")) {
    const map = maps[svg.dataset.map], [x0, y0, dx, dy] = svg.dataset.frame.split(" ").map(Number);
    const rows = 1 + Math.max(...map.cells.map(([row]) => row)), columns = map.x.length;
    const cell = (row, column) => map.cells[row * columns + column];
    let place = null;
    const point = (event) => {
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
      const row = Math.round((at.y - y0) / dy), x = (at.x - x0) / dx;
      const column = map.x.findIndex((middle) => Math.abs(x - middle) <= 0.5);
      if (row < 0 || row >= rows || column < 0) return hide();
      place = [row, column];
      show(svg, map, cell(row, column), event);
    };
    svg.addEventListener("pointermove", point);
    svg.addEventListener("click", point);
    svg.addEventListener("pointerleave", (event) => { if (event.pointerType === "mouse") hide(); });
    svg.addEventListener("blur", hide);
    svg.addEventListener("keydown", (event) => {
      const by = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] }[event.key];
      if (event.key === "Escape") return hide();
      if (!by) return;
      event.preventDefault();
      place = place === null ? [0, 0] : [Math.min(rows - 1, Math.max(0, place[0] + by[0])),
        Math.min(columns - 1, Math.max(0, place[1] + by[1]))];
      show(svg, map, cell(...place), null);
    });
  }
  window.addEventListener("scroll", hide, { passive: true });

  const player = document.getElementById("player");
  if (player) {
    const inflate = async (table) => {
      for (const part of Object.values(table).filter((one) => one.deflated)) {
        const bytes = Uint8Array.from(atob(part.codes), (c) => c.charCodeAt(0));
        const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
        part.inflated = new Uint8Array(await new Response(stream).arrayBuffer());
      }
      return table;
    };
    const sides = [...player.querySelectorAll(".side")].map(async (side, k) => [side, await inflate(data("replay-" + k))]);
    Promise.all(sides).then((ready) => {
      // Shown first: what is hidden has no width to draw on.
      document.documentElement.classList.add("plays");
      replayPlayer(player, ready, player);
    });
  }
})();
