// The theme, and figures: zoom, moving about, and the values under the pointer. Without it the page says all.
"use strict";
(() => {
  const root = document.documentElement;
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const theme = document.getElementById("theme");
  const isDark = () => (root.dataset.theme || (dark.matches ? "dark" : "light")) === "dark";
  const name = () => { theme.textContent = isDark() ? "Light" : "Dark"; };
  theme.addEventListener("click", () => { root.dataset.theme = isDark() ? "light" : "dark"; name(); });
  dark.addEventListener("change", name);
  name();
  // Paper is white: print in light, and open nothing that was closed.
  let before;
  addEventListener("beforeprint", () => { before = root.dataset.theme; root.dataset.theme = "light"; });
  addEventListener("afterprint", () => { if (before) root.dataset.theme = before; else delete root.dataset.theme; });
  for (const hidden of document.querySelectorAll(".no-script")) hidden.classList.remove("no-script");

  const SVG = "http://www.w3.org/2000/svg";
  const digits = (value) => {
    if (!Number.isFinite(value)) return String(value);
    const size = Math.abs(value);
    return size && (size < 1e-3 || size >= 1e6) ? value.toExponential(3) : String(+value.toPrecision(5));
  };

  // What the pixels of a plot mean: data-box, data-x and data-y say it.
  class Plot {
    constructor(group) {
      this.group = group;
      [this.left, this.top, this.width, this.height] = group.dataset.box.split(" ").map(Number);
      this.x = group.dataset.x.split(" ");
      this.y = group.dataset.y.split(" ");
      this.lines = [...group.querySelectorAll("path[data-name]")].map((path) => ({
        name: path.dataset.name || group.dataset.yLabel || "y", path, points: points(path.getAttribute("d")),
      })).filter((line) => line.points.length > 1);
    }
    value(scale, share) {
      const [kind, low, high] = [scale[0], +scale[1], +scale[2]];
      return kind === "log" ? low * Math.pow(high / low, share) : low + (high - low) * share;
    }
    across(px) { return this.value(this.x, (px - this.left) / this.width); }
    up(px) { return this.value(this.y, 1 - (px - this.top) / this.height); }
    holds(point) {
      return point.x >= this.left && point.x <= this.left + this.width
        && point.y >= this.top && point.y <= this.top + this.height;
    }
  }

  // Polylines only: M x y L x y …, absolute. Each M starts a stretch of its own.
  function points(d) {
    const found = [];
    for (const stretch of (d || "").split("M").slice(1)) {
      const numbers = (stretch.match(/-?[\d.]+(?:e-?\d+)?/g) || []).map(Number);
      for (let k = 0; k + 1 < numbers.length; k += 2) found.push([numbers[k], numbers[k + 1], k === 0]);
    }
    return found;
  }

  // Where a line is at a place: between its neighbours; nothing where it has a gap. Of a line that passes the
  // place several times, such as a locus, the height nearest to the pointer.
  function height(line, x, near) {
    let best = null;
    for (let k = 1; k < line.length; k += 1) {
      const [a, b] = [line[k - 1], line[k]];
      if (b[2] || x < Math.min(a[0], b[0]) || x > Math.max(a[0], b[0])) continue;
      const here = a[0] === b[0]
        ? Math.min(Math.max(near, Math.min(a[1], b[1])), Math.max(a[1], b[1]))
        : a[1] + (b[1] - a[1]) * (x - a[0]) / (b[0] - a[0]);
      if (best === null || Math.abs(here - near) < Math.abs(best - near)) best = here;
    }
    return best;
  }

  for (const picture of document.querySelectorAll(".picture")) {
    const svg = picture.querySelector("svg");
    const tools = picture.parentElement.querySelector(".tools");
    if (!svg || !tools) continue;
    const whole = svg.getAttribute("viewBox").split(" ").map(Number);
    let box = [...whole];
    const output = tools.querySelector("output");
    const plots = [...svg.querySelectorAll("g.plot[data-box]")].map((group) => new Plot(group));
    const marks = document.createElementNS(SVG, "g");
    svg.append(marks);

    const show = () => {
      svg.setAttribute("viewBox", box.map((value) => +value.toFixed(3)).join(" "));
      picture.classList.toggle("free", box[2] < whole[2]);
    };
    const clamp = () => {
      box[0] = Math.min(Math.max(box[0], whole[0]), whole[0] + whole[2] - box[2]);
      box[1] = Math.min(Math.max(box[1], whole[1]), whole[1] + whole[3] - box[3]);
    };
    const zoom = (factor, x = box[0] + box[2] / 2, y = box[1] + box[3] / 2) => {
      const next = Math.min(Math.max(box[2] * factor, whole[2] / 40), whole[2]) / box[2];
      box = [x - (x - box[0]) * next, y - (y - box[1]) * next, box[2] * next, box[3] * next];
      clamp();
      show();
    };
    const move = (dx, dy) => { box[0] += dx; box[1] += dy; clamp(); show(); };
    const at = (event) => {
      const matrix = svg.getScreenCTM();
      return matrix ? new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix.inverse()) : null;
    };
    const read = (x, y, nearest) => {
      marks.replaceChildren();
      const plot = plots.find((one) => one.holds({ x, y }));
      if (!plot) { output.textContent = ""; return; }
      const rule = document.createElementNS(SVG, "path");
      rule.setAttribute("class", "pointer");
      rule.setAttribute("d", `M${x} ${plot.top}V${plot.top + plot.height}`);
      marks.append(rule);
      const said = [`${plot.group.dataset.xLabel || "x"}: ${digits(plot.across(x))}`];
      for (const line of plot.lines) {
        const y_at = height(line.points, x, y);
        if (y_at === null || y_at < plot.top - 1 || y_at > plot.top + plot.height + 1) continue;
        said.push(`${line.name}: ${digits(plot.up(y_at))}`);
        const dot = document.createElementNS(SVG, "circle");
        for (const [key, value] of [["cx", x], ["cy", y_at], ["r", 3.5], ["class", "hit"]]) dot.setAttribute(key, value);
        dot.style.stroke = getComputedStyle(line.path).stroke;
        marks.append(dot);
      }
      // Where there are curves, the pointer's own height is no value of theirs.
      if (!plot.lines.length && nearest) said.push(`${plot.group.dataset.yLabel || "y"}: ${digits(plot.up(y))}`);
      output.textContent = said.slice(0, 9).join(" · ");
    };

    tools.addEventListener("click", (event) => {
      const action = event.target.dataset && event.target.dataset.do;
      if (action === "in") zoom(0.6);
      if (action === "out") zoom(1 / 0.6);
      if (action === "all") { box = [...whole]; show(); }
    });
    picture.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.metaKey) return; // a page that is scrolled past goes on scrolling
      event.preventDefault();
      const point = at(event);
      if (point) zoom(event.deltaY < 0 ? 0.8 : 1.25, point.x, point.y);
    }, { passive: false });
    let held = null;
    svg.addEventListener("pointerdown", (event) => {
      if (box[2] < whole[2]) { held = at(event); picture.classList.add("held"); svg.setPointerCapture(event.pointerId); }
    });
    svg.addEventListener("pointermove", (event) => {
      const point = at(event);
      if (!point) return;
      if (held) move(held.x - point.x, held.y - point.y);
      else read(point.x, point.y, true);
    });
    const release = () => { held = null; picture.classList.remove("held"); };
    svg.addEventListener("pointerup", release);
    svg.addEventListener("pointercancel", release);
    svg.addEventListener("pointerleave", () => { if (!held) { marks.replaceChildren(); output.textContent = ""; } });

    // By keys: + - 0 zoom; arrows read a plot's values, or move about in what is zoomed.
    let place = 0.5;
    picture.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (event.key === "+" || event.key === "=") zoom(0.8);
      else if (event.key === "-") zoom(1.25);
      else if (event.key === "0") { box = [...whole]; show(); }
      else if (step && box[2] < whole[2]) move(step[0] * box[2] / 10, step[1] * box[3] / 10);
      else if (step && step[0] && plots.length) {
        place = Math.min(Math.max(place + step[0] / 100, 0), 1);
        const plot = plots[0];
        read(plot.left + place * plot.width, plot.top + plot.height / 2, false);
      } else return;
      event.preventDefault();
    });
  }
})();
