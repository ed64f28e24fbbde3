// Records: subplots over one axis, drawn from their samples for a window of it, as wide as the page.
"use strict";
const Records = (() => {
  const SVG = "http://www.w3.org/2000/svg";
  const [LEFT, RIGHT, GAP, TITLE, BELOW] = [64, 12, 10, 24, 38]; // px
  const [LEAST, PAPER] = [8, 690]; // samples of a window; width of A4 less its margins, px
  const [NO_VALUE, STEPS] = [65535, 65534];
  const ANGLES = [15, 30, 45, 90, 180, 360];
  const element = (parent, name, attributes, text) => {
    const made = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    if (text !== undefined) made.textContent = text;
    parent.append(made);
    return made;
  };

  // The values of a stored array, on the coordinate of its axis: of a logarithmic one the logarithms.
  const bytes = (text) => {
    const letters = atob(text);
    const result = new Uint8Array(letters.length);
    for (let k = 0; k < letters.length; k += 1) result[k] = letters.charCodeAt(k);
    return result.buffer;
  };
  const positions = (stored, log) => {
    if (stored.numbers) return Float64Array.from(new Float32Array(bytes(stored.numbers))).map(log ? Math.log : (x) => x);
    const [from, to] = log ? [Math.log(stored.from), Math.log(stored.to)] : [stored.from, stored.to];
    const [x, step] = [new Float64Array(stored.count), (to - from) / Math.max(stored.count - 1, 1)];
    for (let k = 0; k < x.length; k += 1) x[k] = from + k * step;
    return x;
  };
  const heights = (stored) => {
    const [codes, step] = [new Uint16Array(bytes(stored.codes)), (stored.high - stored.low) / STEPS];
    const y = new Float64Array(codes.length);
    for (let k = 0; k < y.length; k += 1) y[k] = codes[k] === NO_VALUE ? NaN : stored.low + codes[k] * step;
    return y;
  };

  // Ticks at round values, with a common power of ten; `least` is their least distance: 15 of angles.
  const linear = (low, high, count, least) => {
    const raw = Math.max((high - low) / count, least || 0);
    const power = 10 ** Math.floor(Math.log10(raw));
    const step = least >= 15 ? ANGLES.find((angle) => angle >= raw) || 360 * Math.ceil(raw / 360)
      : [1, 2, 2.5, 5, 10].map((factor) => factor * power).find((round) => round >= raw * (1 - 1e-9));
    const values = [];
    for (let k = Math.ceil(low / step - 1e-9); k <= high / step + 1e-9; k += 1) values.push(k * step);
    const magnitude = Math.floor(Math.log10(Math.max(...values.map(Math.abs)) || step) + 1e-12);
    const shared = magnitude >= 5 || magnitude < -2 ? 3 * Math.floor(magnitude / 3) : 0;
    const unit = 10 ** shared;
    const digits = Math.max(0, -Math.floor(Math.log10(step / unit) + 1e-9)) + (power * 2.5 === step ? 1 : 0);
    const text = (value) => (value / unit).toFixed(Math.min(digits, 12)).replace(/^-(?=.*[1-9])/, "−").replace(/^-/, "");
    return { values, labels: values.map(text), power: shared, minor: [] };
  };
  const raised = (power) => `10${String(power).replace(/./g, (sign) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(sign)])}`;
  const logarithmic = (low, high, count) => {
    const [first, last] = [Math.ceil(Math.log10(low) - 1e-9), Math.floor(Math.log10(high) + 1e-9)];
    const [values, minor] = [[], []];
    const text = (value) => (value >= 1e-3 && value < 1e5 ? String(+value.toPrecision(3)) : raised(Math.round(Math.log10(value))));
    if (last - first >= 2) {
      const step = Math.ceil((last - first + 1) / count);
      for (let p = first - 1; p <= last; p += 1) {
        if (p >= first) (p % step ? minor : values).push(10 ** p);
        for (let k = 2; k < 10 && last - first < 5; k += 1) minor.push(k * 10 ** p);
      }
      return { values, labels: values.map(text), power: 0, minor: minor.filter((value) => value > low && value < high) };
    }
    for (let p = first - 1; p <= last; p += 1) {
      for (let k = 1; k < 10; k += 1) {
        const value = k * 10 ** p;
        if (value >= low && value <= high) ([1, 2, 5].includes(k) ? values : minor).push(value);
      }
    }
    if (values.length < 2 || values.length > count || values[0] < 1e-3 || high >= 1e5) return linear(low, high, count);
    return { values, labels: values.map(text), power: 0, minor };
  };
  const ticks = (axis, low, high, count) => (axis.log ? logarithmic(Math.exp(low), Math.exp(high), count) : linear(low, high, count, axis.step));
  const withPower = (label, power) => {
    if (!power || !label) return label;
    const at = label.endsWith(")") ? label.lastIndexOf(" (") : -1;
    return at < 0 ? `${label} (${raised(power)})` : `${label.slice(0, at)} (${raised(power)} ${label.slice(at + 2)}`;
  };

  // The first sample at x or beyond it.
  const search = (x, value, from = 0) => {
    let [low, high] = [from, x.length];
    while (low < high) { const middle = (low + high) >> 1; if (x[middle] < value) low = middle + 1; else high = middle; }
    return low;
  };
  const nearest = (x, value) => {
    const at = Math.min(search(x, value), x.length - 1);
    return at > 0 && value - x[at - 1] < x[at] - value ? at - 1 : at;
  };

  // The points of samples from … to - 1: all, or the extremes of each column of pixels where they are dense.
  const decimated = (x, y, from, to, pixel, place, up) => {
    const points = [];
    const [first, last] = [Math.floor(pixel(x[from])), Math.ceil(pixel(x[to - 1]))];
    if (to - from <= 2 * (last - first)) {
      for (let k = from; k < to; k += 1) points.push([pixel(x[k]), up(y[k])]);
      return points;
    }
    for (let column = first, k = from; k < to; column += 1) {
      const end = column >= last ? to : Math.min(search(x, place(column + 1), k), to);
      let [least, most, gap] = [-1, -1, false];
      for (; k < end; k += 1) {
        if (y[k] !== y[k]) gap = true;
        else {
          if (least < 0 || y[k] < y[least]) least = k;
          if (most < 0 || y[k] > y[most]) most = k;
        }
      }
      if (least >= 0) for (const at of least < most ? [least, most] : [most, least]) points.push([column + 0.5, up(y[at])]);
      if (gap) points.push([column + 0.5, NaN]);
    }
    return points;
  };
  const path = (points) => {
    let pen = "M";
    let d = "";
    for (const [x, y] of points) {
      if (Number.isNaN(y)) { pen = "M"; continue; }
      d += `${pen}${x.toFixed(1)} ${y.toFixed(1)}`;
      pen = "L";
    }
    return d;
  };
  const dots = (points, r) => points.filter(([, y]) => !Number.isNaN(y))
    .map(([x, y]) => `M${(x - r).toFixed(1)} ${y.toFixed(1)}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0`).join("");

  // `tell` passes on which value of x the pointer is at; `page` writes numbers.
  return (figure, stored, page, tell) => {
    const [svg, picture, output] = [".picture > svg", ".picture", ".tools output"].map((name) => figure.querySelector(name));
    const coordinate = stored.x.log ? Math.log : (value) => value;
    const value = stored.x.log ? Math.exp : (place) => place;
    const all = [coordinate(stored.x.low), coordinate(stored.x.high)];
    const label = stored.x.label;
    let [plots, longest, drawn] = [[], null, []];
    // The samples are read when the figure is about to be seen.
    const read = () => {
      const same = {};
      plots = stored.plots.map((plot) => ({
        ...plot,
        all: plot.log ? [Math.log(plot.low), Math.log(plot.high)] : [plot.low, plot.high],
        layers: plot.layers.map((layer) => {
          if (typeof layer.x !== "object") return { ...layer };
          const key = JSON.stringify(layer.x);
          same[key] = same[key] || positions(layer.x, stored.x.log);
          return { ...layer, x: same[key], y: heights(layer.y), high: layer.high && heights(layer.high) };
        }),
      }));
      const all = plots.flatMap((plot) => plot.layers);
      for (const layer of all.filter((one) => one.difference)) {
        const [a, b] = layer.difference.map(([plot, index]) => plots[plot].layers[index]);
        [layer.x, layer.y] = [a.x, a.y.map((value, k) => value - b.y[k])];
      }
      for (const layer of all) if (layer.x && layer.x.length > (longest ? longest.x.length : 0)) longest = layer;
    };
    let [low, high] = all;
    let width = 0;
    const whole = () => low <= all[0] && high >= all[1];
    const pixel = (place) => LEFT + (width - LEFT - RIGHT) * (place - low) / (high - low);
    const place = (x) => low + (high - low) * (x - LEFT) / (width - LEFT - RIGHT);
    const range = (layer) => [Math.max(search(layer.x, low) - 1, 0), Math.min(search(layer.x, high) + 1, layer.x.length)];

    // The ends of y: those of the samples in the window; of the whole record, and of angles, the axis as it is.
    const ends = (plot) => {
      if (whole() || plot.fixed) return plot.all;
      let [least, most] = [Infinity, -Infinity];
      for (const layer of plot.layers.filter((one) => one.x && one.x.length)) {
        const [from, to] = range(layer);
        for (let k = from; k < to; k += 1) {
          if (layer.y[k] < least) least = layer.y[k];
          if ((layer.high || layer.y)[k] > most) most = (layer.high || layer.y)[k];
        }
      }
      const margin = 0.04 * (most - least);
      return margin > 0 ? [least - margin, most + margin] : plot.all;
    };
    const drawPlot = (plot, top, tall, last) => {
      const group = element(svg, "g", { class: "plot", "data-box": `${LEFT} ${top} ${width - LEFT - RIGHT} ${tall}`,
        "data-x": `${stored.x.log ? "log" : "lin"} ${value(low)} ${value(high)}`, "data-y": `${plot.log ? "log" : "lin"} ${ends(plot).map(plot.log ? Math.exp : (y) => y).join(" ")}`, "data-x-label": label, "data-y-label": plot.y });
      const [least, most] = ends(plot);
      const up = (y) => top + tall * (1 - (y - least) / (most - least));
      const log = (number) => (plot.log ? Math.log(number) : number);
      const right = width - RIGHT;
      const across = ticks(stored.x, low, high, Math.max(2, Math.floor((width - LEFT) / 80)));
      const upright = ticks(plot, least, most, Math.max(2, Math.floor(tall / 26)));
      const grid = [...across.values, ...across.minor].map((x) => `M${pixel(coordinate(x)).toFixed(1)} ${top}v${tall}`)
        .concat([...upright.values, ...upright.minor].map((y) => `M${LEFT} ${up(log(y)).toFixed(1)}H${right}`)).join("");
      element(group, "path", { class: "grid", d: grid });
      const inner = element(group, "svg", { x: LEFT, y: top - 1, width: right - LEFT, height: tall + 2, viewBox: `${LEFT} ${top - 1} ${right - LEFT} ${tall + 2}` });
      for (const layer of plot.layers) {
        if (!layer.x || !layer.x.length) {
          const d = layer.x === undefined ? `M${LEFT} ${up(log(layer.y))}H${right}` : `M${pixel(coordinate(layer.x))} ${top}v${tall}`;
          element(inner, "path", { class: layer.cls, d });
          continue;
        }
        const [from, to] = range(layer);
        if (from >= to) continue;
        const points = decimated(layer.x, layer.y, from, to, pixel, place, up);
        if (layer.high) {
          const back = decimated(layer.x, layer.high, from, to, pixel, place, up).reverse();
          element(inner, "path", { class: layer.cls, d: `${path([...points, ...back].filter(([, y]) => !Number.isNaN(y)))}Z` });
        } else if (layer.r) {
          element(inner, "path", { class: layer.cls, d: dots(points, layer.r) });
        } else {
          element(inner, "path", { class: layer.cls, "data-name": layer.name, d: path(points), "stroke-linejoin": "round" });
          // Single samples, where they are apart.
          if (!whole() && to - from < (right - LEFT) / 8) element(inner, "path", { class: `${layer.cls.split(" ")[0]} dot`, d: dots(points, 2) });
        }
      }
      element(group, "rect", { class: "frame", x: LEFT, y: top, width: right - LEFT, height: tall });
      upright.values.forEach((y, k) => {
        element(group, "text", { class: "small tick", x: LEFT - 7, y: up(log(y)) + 3.5, "text-anchor": "end" }, upright.labels[k]);
      });
      const middle = top + tall / 2;
      const title = plot.title && plot.title !== plot.label ? plot.title : "";
      if (title) element(group, "text", { class: "strong", x: LEFT + (right - LEFT) / 2, y: top - 7, "text-anchor": "middle" }, title);
      element(group, "text", { class: "label small", x: 14, y: middle, "text-anchor": "middle", transform: `rotate(-90 14 ${middle})` }, withPower(plot.label, upright.power));
      if (last) {
        across.values.forEach((x, k) => {
          element(group, "text", { class: "small tick", x: pixel(coordinate(x)), y: top + tall + 14, "text-anchor": "middle" }, across.labels[k]);
        });
        element(group, "text", { class: "label", x: LEFT + (right - LEFT) / 2, y: top + tall + 33, "text-anchor": "middle" }, withPower(label, across.power));
      }
      return { ...plot, top, tall, up };
    };
    let marks;
    const draw = () => {
      if (!plots.length) read();
      while (svg.lastElementChild && !["title", "desc"].includes(svg.lastElementChild.localName)) svg.lastElementChild.remove();
      let top = 2;
      drawn = plots.map((plot, k) => {
        top += plot.title ? TITLE : GAP;
        const result = drawPlot(plot, top, plot.height, k === plots.length - 1);
        top += plot.height;
        return result;
      });
      for (const [key, size] of [["width", width], ["height", top + BELOW], ["viewBox", `0 0 ${width} ${top + BELOW}`]]) svg.setAttribute(key, size);
      marks = element(svg, "g", {});
      picture.classList.toggle("part", !whole());
    };
    const resize = (size) => {
      if (size > 0 && size !== width) { width = size; draw(); }
    };
    const fit = () => resize(Math.floor(picture.clientWidth));
    // What is below does not move when the figure is drawn, as high as before.
    svg.style.height = `${svg.viewBox.baseVal.height}px`;
    new IntersectionObserver((entries, observer) => {
      if (!entries.some((entry) => entry.isIntersecting)) return;
      observer.disconnect();
      new ResizeObserver(fit).observe(picture);
    }, { rootMargin: "100%" }).observe(picture);
    // Paper is narrower than most screens.
    addEventListener("beforeprint", () => resize(PAPER));
    addEventListener("afterprint", fit);

    const clear = () => { if (marks) marks.replaceChildren(); output.textContent = ""; };
    const mark = (quantity, at, near) => {
      clear();
      if (quantity !== label || !drawn.length || !(coordinate(at) >= low && coordinate(at) <= high)) return;
      const sample = longest.x[nearest(longest.x, coordinate(at))];
      const [name, unit] = page.parts(label);
      const said = [];
      const line = { class: "pointer", d: `M${pixel(sample)} ${drawn[0].top}V${drawn.at(-1).top + drawn.at(-1).tall}` };
      element(marks, "path", line);
      drawn.forEach((plot, k) => {
        const [quantityOfY, unitOfY] = page.parts(plot.y);
        for (const layer of plot.layers) {
          if (!layer.x || !layer.x.length || layer.high) continue;
          const y = layer.y[nearest(layer.x, sample)];
          const apart = Math.abs(pixel(layer.x[nearest(layer.x, sample)]) - pixel(sample));
          if (Number.isNaN(y) || apart > 3) continue;
          element(marks, "circle", { class: `hit ${layer.cls.split(" ")[0]}`, cx: pixel(sample), cy: plot.up(y), r: 3.5 });
          said.push([k, `${layer.name || quantityOfY}: ${page.withUnit(plot.log ? Math.exp(y) : y, unitOfY)}`]);
        }
      });
      const first = said.length > 12 ? Math.max(said.findIndex(([k]) => k >= (near ? near.index : 0)), 0) : 0;
      output.textContent = [`${name}: ${page.withUnit(value(sample), unit)}`, ...said.slice(first, first + 12).map(([, text]) => text)].join(" · ");
    };
    const window = (from, to) => {
      const least = LEAST * (all[1] - all[0]) / Math.max(longest ? longest.x.length : 1, 2 * LEAST);
      const size = Math.min(Math.max(to - from, least), all[1] - all[0]);
      low = Math.min(Math.max((from + to - size) / 2, all[0]), all[1] - size);
      high = low + size;
      draw();
    };
    const zoom = (factor, around = (low + high) / 2) => window(around - (around - low) * factor, around + (high - around) * factor);
    const move = (share) => { const shift = Math.min(Math.max(share * (high - low), all[0] - low), all[1] - high); window(low + shift, high + shift); };
    const reset = () => { [low, high] = all; draw(); };

    figure.querySelector(".tools").addEventListener("click", (event) => {
      const action = event.target.dataset && event.target.dataset.do;
      if (action === "in") zoom(0.5);
      if (action === "out") zoom(2);
      if (action === "all") reset();
    });
    const at = (event) => (event.clientX - svg.getBoundingClientRect().left) * width / svg.getBoundingClientRect().width;
    // The wheel zooms in a figure that has the focus, by a click or by keys; others are scrolled past.
    picture.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.metaKey && document.activeElement !== picture) return;
      event.preventDefault();
      if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) move(Math.sign(event.deltaX) / 20);
      else zoom(event.deltaY < 0 ? 0.8 : 1.25, place(at(event)));
    }, { passive: false });
    let start = null;
    svg.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      start = at(event);
      svg.setPointerCapture(event.pointerId);
      picture.focus({ preventScroll: true });
    });
    const inside = (x) => Math.min(Math.max(x, LEFT), width - RIGHT);
    svg.addEventListener("pointermove", (event) => {
      const x = at(event);
      if (start !== null && Math.abs(x - start) > 4) {
        clear();
        const [a, b] = [inside(Math.min(x, start)), inside(Math.max(x, start))];
        element(marks, "rect", { class: "window", x: a, y: drawn[0].top, width: b - a, height: drawn.at(-1).top + drawn.at(-1).tall - drawn[0].top });
      } else if (inside(x) === x && longest) {
        const y = event.clientY - svg.getBoundingClientRect().top;
        tell(label, value(longest.x[nearest(longest.x, place(x))]), { index: drawn.findIndex((plot) => y < plot.top + plot.tall) });
      }
    });
    svg.addEventListener("pointerup", (event) => {
      const [from, to] = [start, at(event)];
      start = null;
      if (from !== null && Math.abs(to - from) > 4) window(place(inside(Math.min(from, to))), place(inside(Math.max(from, to))));
    });
    svg.addEventListener("pointercancel", () => { start = null; clear(); });
    svg.addEventListener("pointerleave", () => { if (start === null) tell("", 0); });
    svg.addEventListener("dblclick", reset);

    // By keys: + - 0 zoom, arrows move the cursor, with Shift the window.
    let cursor = NaN;
    picture.addEventListener("keydown", (event) => {
      const way = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (event.key === "+" || event.key === "=") zoom(0.8);
      else if (event.key === "-") zoom(1.25);
      else if (event.key === "0" || event.key === "Escape") reset();
      else if (way && event.shiftKey) move(way / 10);
      else if (way) {
        cursor = cursor >= low && cursor <= high ? cursor : (low + high) / 2;
        cursor = Math.min(Math.max(cursor + way * (high - low) / 200, low), high);
        tell(label, value(cursor));
      } else return;
      event.preventDefault();
    });
    return { clear, mark };
  };
})();
