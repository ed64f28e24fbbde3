// Samples of a study: a table to page through, sort and filter, with statistics and a histogram of one column.
"use strict";
(() => {
  const host = document.getElementById("sample-table");
  const stored = JSON.parse(document.getElementById("samples-data").textContent);
  const make = (name, attributes = {}, ...children) => {
    const element = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) {
      if (key in element && typeof value === "boolean") element[key] = value;
      else element.setAttribute(key, value);
    }
    element.append(...children);
    return element;
  };
  const TYPES = { "<f4": Float32Array, "<f8": Float64Array, "<u2": Uint16Array };
  const unpack = (column) => {
    const bytes = Uint8Array.from(atob(column.data), (letter) => letter.charCodeAt(0));
    return new TYPES[column.type](bytes.buffer);
  };
  const columns = stored.columns.map((column) => ({
    ...column, data: undefined, values: unpack(column), title: column.units ? `${column.name} [${column.units}]` : column.name,
    heading: column.units ? `${column.short} [${column.units}]` : column.short,
  }));
  const digits = (value) => {
    if (Number.isNaN(value)) return "—";
    if (!Number.isFinite(value)) return value > 0 ? "∞" : "-∞";
    const size = Math.abs(value);
    return Number.isInteger(value) && size < 1e15 ? String(value)
      : size < 1e-4 || size >= 1e7 ? value.toExponential(5) : String(+value.toPrecision(7));
  };
  const said = (column, row) => column.levels ? column.levels[column.values[row]] : digits(column.values[row]);

  const SIZE = 25;
  let rows = Uint32Array.from({ length: stored.rows }, (_, row) => row);
  let page = 0;
  let order = { place: -1, down: false };
  const filters = new Map();

  // One column at a time: choose it, and bound it.
  const choice = make("select", { "aria-label": "Column" });
  columns.forEach((column, place) => choice.append(make("option", { value: place }, column.title)));
  const isResult = (column) => column.role === "result" && !column.levels;
  const varies = (column) => {
    const known = column.values.filter((value) => !Number.isNaN(value));
    return known.some((value) => value !== known[0]);
  };
  const varied = columns.findIndex((column) => isResult(column) && varies(column));
  choice.value = String(Math.max(0, varied < 0 ? columns.findIndex(isResult) : varied));
  const from = make("input", { size: 9, "aria-label": "at least", placeholder: "at least" });
  const to = make("input", { size: 9, "aria-label": "at most", placeholder: "at most" });
  const holds = make("input", { size: 16, "aria-label": "contains", placeholder: "contains" });
  const clear = make("button", { type: "button" }, "All samples");
  const count = make("output", {});
  const about = make("p", { class: "quiet" });
  const picture = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  const numbers = make("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": "Statistics of the chosen column" });
  const table = make("table");
  const pages = make("div", { class: "tools pages" });
  const turn = (label, sign, target) => {
    const button = make("button", { type: "button", "aria-label": label, title: label }, sign);
    button.addEventListener("click", () => { page = target(); draw(); });
    pages.append(button);
    return button;
  };
  const last = () => Math.max(0, Math.ceil(rows.length / SIZE) - 1);
  const buttons = [turn("First page", "«", () => 0), turn("Page before", "‹", () => page - 1),
    turn("Next page", "›", () => page + 1), turn("Last page", "»", last)];
  const where = make("output", {});
  pages.append(where);

  const chosen = () => columns[+choice.value];
  const number = (field) => {
    const text = field.value.trim().replace(",", ".");
    const value = text === "" ? NaN : Number(text);
    field.setAttribute("aria-invalid", text !== "" && Number.isNaN(value) ? "true" : "false");
    return value;
  };
  const sift = () => {
    const every = [...filters.values()];
    const kept = [];
    for (let row = 0; row < stored.rows; row += 1) if (every.every((keep) => keep(row))) kept.push(row);
    rows = Uint32Array.from(kept);
    sort();
    page = 0;
    draw();
  };
  const sort = () => {
    if (order.place < 0) return;
    const { values, levels } = columns[order.place];
    const sign = order.down ? -1 : 1;
    const rank = levels ? levels.map((_, place) => place) : null;
    rows = rows.slice().sort((a, b) => {
      const [x, y] = rank ? [rank[values[a]], rank[values[b]]] : [values[a], values[b]];
      const [p, q] = [Number.isNaN(x), Number.isNaN(y)];
      return p || q ? p - q || a - b : sign * (x < y ? -1 : x > y ? 1 : 0) || a - b; // what has no value is last
    });
  };
  const set = () => {
    const column = chosen();
    if (column.levels) {
      const wanted = holds.value.toLowerCase();
      const hit = column.levels.map((level) => level.toLowerCase().includes(wanted));
      if (wanted) filters.set(column, (row) => hit[column.values[row]]); else filters.delete(column);
    } else {
      const [low, high] = [number(from), number(to)];
      if (Number.isNaN(low) && Number.isNaN(high)) filters.delete(column);
      else filters.set(column, (row) => !(column.values[row] < low) && !(column.values[row] > high) && !Number.isNaN(column.values[row]));
    }
    sift();
  };
  const choose = () => {
    const text = Boolean(chosen().levels);
    holds.hidden = !text;
    from.hidden = to.hidden = text;
    from.value = to.value = holds.value = "";
    draw();
  };
  choice.addEventListener("change", choose);
  for (const field of [from, to, holds]) field.addEventListener("input", set);
  clear.addEventListener("click", () => { filters.clear(); from.value = to.value = holds.value = ""; sift(); });

  const quantile = (ordered, share) => {
    const place = share * (ordered.length - 1);
    const below = Math.floor(place);
    const above = Math.min(below + 1, ordered.length - 1);
    return ordered[below] + (place - below) * (ordered[above] - ordered[below]);
  };
  const statistics = (column) => {
    const known = Float64Array.from(rows, (row) => column.values[row]).filter((value) => !Number.isNaN(value)).sort();
    const size = known.length;
    if (!size) return [["count", 0]];
    if (known[0] === known[size - 1]) return [["count", size], ["every sample", known[0]]];
    const mean = known.reduce((sum, value) => sum + value / size, 0);
    const spread = known.reduce((sum, value) => sum + (value - mean) ** 2, 0);
    return [["count", size], ["mean", mean], ["std", Math.sqrt(spread / (size - 1))], ["min", known[0]],
      ["p05", quantile(known, 0.05)], ["median", quantile(known, 0.5)], ["p95", quantile(known, 0.95)], ["max", known[size - 1]]];
  };

  const SVG = "http://www.w3.org/2000/svg";
  const shape = (name, attributes, text) => {
    const element = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    if (text !== undefined) element.textContent = text;
    return element;
  };
  const histogram = (column) => {
    picture.replaceChildren();
    for (const [key, value] of [["viewBox", "0 0 640 170"], ["class", "fig bars"], ["role", "img"], ["width", "640"], ["height", "170"]]) picture.setAttribute(key, value);
    const finite = column.values.filter((value) => Number.isFinite(value));
    let labels = [];
    let bin;
    let bins;
    if (column.levels) {
      bins = Math.min(column.levels.length, 30);
      bin = (value) => value;
      labels = bins > 1 ? [column.levels[0], column.levels[bins - 1]] : [column.levels[0], ""];
    } else {
      let [low, high] = [Infinity, -Infinity];
      for (const value of finite) { low = Math.min(low, value); high = Math.max(high, value); }
      bins = low < high ? Math.max(5, Math.min(40, Math.ceil(Math.sqrt(finite.length)))) : 1;
      bin = (value) => Number.isFinite(value) ? Math.min(bins - 1, Math.floor((value - low) / ((high - low) || 1) * bins)) : -1;
      labels = finite.length ? [digits(low), digits(high)] : ["no value", ""];
    }
    const [all, some] = [new Array(bins).fill(0), new Array(bins).fill(0)];
    for (const value of column.values) if (bin(value) >= 0 && bin(value) < bins) all[bin(value)] += 1;
    for (const row of rows) { const place = bin(column.values[row]); if (place >= 0 && place < bins) some[place] += 1; }
    const most = Math.max(1, ...all);
    const title = `Histogram of ${column.title}: ${rows.length} of ${stored.rows} samples, ${labels[0]} to ${labels[1]}`;
    picture.append(shape("title", {}, title));
    const width = 600 / bins;
    for (const [counts, style] of [[all, "of-all"], [some, ""]]) {
      counts.forEach((value, place) => {
        if (!value) return;
        const size = 128 * value / most;
        const bar = shape("rect", { x: (20 + place * width).toFixed(2), y: (140 - size).toFixed(2), width: Math.max(1, width - 1).toFixed(2), height: size.toFixed(2), class: style });
        bar.append(shape("title", {}, `${value}`));
        picture.append(bar);
      });
    }
    picture.append(shape("path", { d: "M20 140.5H620", class: "line" }), shape("text", { x: 20, y: 158 }, labels[0]),
      shape("text", { x: 620, y: 158, "text-anchor": "end" }, labels[1]), shape("text", { x: 20, y: 10, class: "small muted" }, `most: ${most}`));
  };

  const draw = () => {
    page = Math.min(Math.max(page, 0), last());
    const column = chosen();
    count.textContent = `${rows.length.toLocaleString("en")} of ${stored.rows.toLocaleString("en")} samples`;
    about.textContent = filters.size ? `filtered by ${[...filters.keys()].map((one) => one.title).join(", ")}` : "";
    histogram(column);
    numbers.replaceChildren();
    if (!column.levels) {
      const found = statistics(column);
      numbers.append(make("table", {}, make("thead", {}, make("tr", {}, ...found.map(([name]) => make("th", { scope: "col", class: "n" }, name)))),
        make("tbody", {}, make("tr", {}, ...found.map(([, value]) => make("td", { class: "n" }, digits(value)))))));
    }
    const body = make("tbody");
    for (const row of rows.subarray(page * SIZE, (page + 1) * SIZE)) {
      body.append(make("tr", {}, ...columns.map((one) => make("td", one.levels ? {} : { class: "n" }, said(one, row)))));
    }
    table.tBodies[0].replaceWith(body);
    where.textContent = rows.length ? `rows ${page * SIZE + 1} … ${Math.min((page + 1) * SIZE, rows.length)} of ${rows.length.toLocaleString("en")}, page ${page + 1} of ${last() + 1}` : "no sample";
    buttons.forEach((button, place) => { button.disabled = place < 2 ? page === 0 : page >= last(); });
    heads.forEach((head, place) => {
      const sorted = place === order.place;
      head.setAttribute("aria-sort", sorted ? (order.down ? "descending" : "ascending") : "none");
      head.firstChild.textContent = columns[place].heading + (sorted ? (order.down ? " ▼" : " ▲") : "");
    });
  };
  const heads = columns.map((column, place) => {
    const button = make("button", { type: "button", title: column.title }, column.heading);
    button.addEventListener("click", () => {
      order = { place, down: order.place === place && !order.down };
      sort();
      page = 0;
      draw();
    });
    return make("th", { scope: "col", ...(column.levels ? {} : { class: "n" }) }, button);
  });
  table.append(make("thead", {}, make("tr", {}, ...heads)), make("tbody"));
  host.append(make("div", { class: "tools" }, make("label", {}, "Column ", choice), from, to, holds, clear, count), about,
    make("div", { class: "picture" }, picture), numbers, pages,
    make("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": "Table of samples" }, table));
  choose();
})();
