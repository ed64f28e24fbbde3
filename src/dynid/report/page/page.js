// The theme, links into folded parts, and figures: zoom, moving about, and cursors that snap to the curves of all
// figures over the same quantity. Without scripts the page says all.
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
  for (const hidden of document.querySelectorAll(".no-script")) hidden.classList.remove("no-script");

  // A link opens the folded parts around its target.
  const reveal = () => {
    const target = location.hash.length > 1 && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    for (let one = target; one; one = one.parentElement) if (one.localName === "details") one.open = true;
    if (target) target.scrollIntoView();
  };
  addEventListener("hashchange", reveal);
  document.addEventListener("click", (event) => {
    const link = event.target.closest && event.target.closest('a[href^="#"]');
    if (link && link.hash === location.hash) reveal(); // the hash stays, the part may have been folded again
  });
  reveal();

  const SVG = "http://www.w3.org/2000/svg";
  const digits = (value) => {
    if (!Number.isFinite(value)) return String(value);
    const size = Math.abs(value);
    const text = size && (size < 1e-3 || size >= 1e6) ? value.toExponential(3) : String(+value.toPrecision(5));
    return text.replace("-", "−");
  };
  // "magnitude (dB)": the quantity and its unit.
  const parts = (label) => {
    const at = label.endsWith(")") ? label.lastIndexOf(" (") : -1;
    return at < 0 ? [label, ""] : [label.slice(0, at), label.slice(at + 2, -1)];
  };
  const withUnit = (value, unit) => `${digits(value)}${unit === "°" ? "" : " "}${unit}`.trim();

  // What the pixels of a plot mean: data-box, data-x and data-y say it.
  class Plot {
    constructor(group) {
      const data = group.dataset;
      this.group = group;
      [this.left, this.top, this.width, this.height] = data.box.split(" ").map(Number);
      [this.x, this.y] = [data.x.split(" "), data.y.split(" ")];
      [this.xName, this.xUnit] = parts(data.xLabel || "x");
      [this.yName, this.yUnit] = parts(data.yLabel || "y");
      this.over = data.parameter || ""; // what its loci are over, or the size of y in other units
      this.perY = +(data.perY || 0);
      this.lines = [...group.querySelectorAll("path[data-name]")].map((path) => ({
        name: path.dataset.name || this.yName, path, points: points(path.getAttribute("d")),
        along: path.dataset.along ? path.dataset.along.split(" ").map(Number) : null,
      })).filter((line) => line.points.length > 1);
      this.loci = this.lines.filter((line) => line.along);
    }
    value(scale, share) {
      const [kind, low, high] = [scale[0], +scale[1], +scale[2]];
      return kind === "log" ? low * Math.pow(high / low, share) : low + (high - low) * share;
    }
    share(scale, value) {
      const [kind, low, high] = [scale[0], +scale[1], +scale[2]];
      return kind === "log" ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
    }
    across(px) { return this.value(this.x, (px - this.left) / this.width); }
    up(px) { return this.value(this.y, 1 - (px - this.top) / this.height); }
    atX(value) { return this.left + this.width * this.share(this.x, value); }
    atY(value) { return this.top + this.height * (1 - this.share(this.y, value)); }
    holds(x, y) {
      return x >= this.left - 0.01 && x <= this.left + this.width + 0.01
        && y >= this.top - 0.01 && y <= this.top + this.height + 0.01;
    }
    // The quantity and the value that a cursor at a place stands for.
    cursor(x, y) {
      if (this.perY) return [this.over, Math.abs(this.up(y)) * this.perY];
      if (!this.loci.length) return [this.group.dataset.xLabel, this.across(x)];
      let best = [Infinity, 0];
      for (const line of this.loci) {
        line.points.forEach(([a, b], k) => {
          const far = Math.hypot(a - x, b - y);
          if (far < best[0]) best = [far, line.along[k]];
        });
      }
      return [this.over, best[1]];
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

  // The point of a locus at a value of its parameter.
  function pointAt(line, value) {
    for (let k = 1; k < line.points.length; k += 1) {
      const [from, to] = [line.along[k - 1], line.along[k]];
      if (line.points[k][2] || (value - from) * (value - to) > 0) continue;
      const share = from === to ? 0 : (value - from) / (to - from);
      const [a, b] = [line.points[k - 1], line.points[k]];
      return [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])];
    }
    return null;
  }

  const pictures = [];
  const clear = () => { for (const one of pictures) one.clear(); };
  // Mark a value of a quantity on every plot that has it.
  const link = (label, value, near) => { for (const one of pictures) one.mark(label, value, near); };

  for (const picture of document.querySelectorAll(".picture")) {
    const svg = picture.querySelector("svg");
    const tools = picture.parentElement.querySelector(".tools");
    if (!svg || !tools) continue;
    const record = picture.parentElement.querySelector('script[type="application/json"]');
    if (record) {
      pictures.push(Records(picture.parentElement, JSON.parse(record.textContent), { parts, withUnit }, link));
      continue;
    }
    const whole = svg.getAttribute("viewBox").split(" ").map(Number);
    let box = [...whole];
    const output = tools.querySelector("output");
    const plots = [...svg.querySelectorAll("g.plot[data-box]")].map((group) => new Plot(group));
    const marks = document.createElementNS(SVG, "g");
    svg.append(marks);
    const draw = (kind, attributes) => {
      const element = document.createElementNS(SVG, kind);
      for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
      marks.append(element);
      return element;
    };
    const dot = (x, y, path) => {
      const element = draw("circle", { cx: x, cy: y, r: 3.5, class: "hit" });
      if (path) element.style.stroke = getComputedStyle(path).stroke;
    };

    // A figure that is wider than a narrow screen scrolls, until it is shown whole.
    const scrolls = () => picture.scrollWidth > picture.clientWidth + 1;
    const fit = (small) => picture.classList.toggle("whole", small);
    new ResizeObserver(() => picture.classList.toggle("more", scrolls())).observe(svg);

    const readAlongX = (plot, value, near, said) => {
      const x = plot.atX(value);
      if (!(x >= plot.left - 0.01 && x <= plot.left + plot.width + 0.01)) return;
      draw("path", { class: "pointer", d: `M${x} ${plot.top}V${plot.top + plot.height}` });
      for (const line of plot.lines) {
        const y = height(line.points, x, near === null ? plot.top + plot.height / 2 : near);
        if (y === null || y < plot.top - 1 || y > plot.top + plot.height + 1) continue;
        said.push(`${line.name === plot.group.dataset.yLabel ? plot.yName : line.name}: ${withUnit(plot.up(y), plot.yUnit)}`);
        dot(x, y, line.path);
      }
    };
    const readLocus = (plot, value, said) => {
      for (const line of plot.loci) {
        const at = pointAt(line, value);
        if (!at || !plot.holds(...at)) continue;
        const im = plot.up(at[1]);
        said.push(`${line.name}: ${digits(plot.across(at[0]))} ${im < 0 ? "−" : "+"} ${digits(Math.abs(im))}j ${plot.yUnit}`.trim());
        dot(...at, line.path);
      }
    };
    const readUpright = (plot, value) => {
      for (const sign of [1, -1]) {
        const y = plot.atY(sign * value / plot.perY);
        if (plot.holds(plot.left, y)) draw("path", { class: "pointer", d: `M${plot.left} ${y}H${plot.left + plot.width}` });
      }
    };
    const own = {
      clear: () => { marks.replaceChildren(); output.textContent = ""; },
      mark: (label, value, near) => {
        own.clear();
        const said = [];
        let met = false;
        for (const plot of plots) {
          if (!label) continue;
          if (plot.over === label && plot.perY) readUpright(plot, value);
          else if (plot.over === label) readLocus(plot, value, said);
          else if (plot.group.dataset.xLabel === label && plot.lines.length) readAlongX(plot, value, near && near.plot === plot ? near.y : null, said);
          else continue;
          met = true;
        }
        if (!met) return;
        const [quantity, unit] = parts(label);
        output.textContent = [`${quantity}: ${withUnit(value, unit)}`, ...said.slice(0, 12)].join(" · ");
      },
    };
    pictures.push(own);

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
    // The text of the mark nearest to a place: a pole, a bar, a sample.
    const nearest = (plot, x, y) => {
      let best = [14, ""];
      plot.tips = plot.tips || [...plot.group.querySelectorAll("title")].map((title) => [title.parentElement.getBBox(), title.textContent]);
      for (const [area, words] of plot.tips) {
        const far = Math.hypot(x - Math.min(Math.max(x, area.x), area.x + area.width), y - Math.min(Math.max(y, area.y), area.y + area.height));
        if (far < best[0]) best = [far, words];
      }
      return best[1];
    };
    const read = (x, y) => {
      clear();
      const plot = plots.find((one) => one.holds(x, y));
      if (!plot) return;
      link(...plot.cursor(x, y), { plot, y });
      const words = nearest(plot, x, y);
      if (words) output.textContent = output.textContent ? `${words} · ${output.textContent}` : words;
      // Where there are curves, the pointer's own height is no value of theirs.
      if (output.textContent) return;
      output.textContent = [[plot.xName, plot.across(x), plot.xUnit], [plot.yName, plot.up(y), plot.yUnit]]
        .map(([quantity, value, unit]) => `${quantity}: ${withUnit(value, unit)}`).join(" · ");
    };

    const larger = (factor) => { if (picture.classList.contains("whole")) fit(false); else zoom(factor); };
    const smaller = (factor) => { if (box[2] < whole[2]) zoom(factor); else fit(scrolls() || picture.classList.contains("whole")); };
    const all = () => { box = [...whole]; show(); if (scrolls()) fit(true); };
    tools.addEventListener("click", (event) => {
      const action = event.target.dataset && event.target.dataset.do;
      if (action === "in") larger(0.6);
      if (action === "out") smaller(1 / 0.6);
      if (action === "all") all();
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
      else read(point.x, point.y);
    });
    const release = () => { held = null; picture.classList.remove("held"); };
    svg.addEventListener("pointerup", release);
    svg.addEventListener("pointercancel", release);
    svg.addEventListener("pointerleave", () => { if (!held) clear(); });

    // By keys: + - 0 zoom; arrows move the cursor of the first plot, or move about in what is zoomed.
    let place = 0.5;
    picture.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (event.key === "+" || event.key === "=") larger(0.8);
      else if (event.key === "-") smaller(1.25);
      else if (event.key === "0") all();
      else if (step && box[2] < whole[2]) move(step[0] * box[2] / 10, step[1] * box[3] / 10);
      else if (step && step[0] && plots.length) {
        place = Math.min(Math.max(place + step[0] / 100, 0), 1);
        const plot = plots[0];
        read(plot.left + place * plot.width, plot.top + plot.height / 2);
      } else return;
      event.preventDefault();
    });
  }
})();
