// Printing: light, unfolded, and tables as wide as the paper: in smaller type, then as blocks of columns.
"use strict";
(() => {
  const root = document.documentElement;
  // Characters across A4 in 10 pt; and in the smallest type that can be read.
  const [LINE, MOST] = [78, 122];
  let before;
  let closed = [];
  let undo = [];

  // Characters that a cell needs in one line: a number all of them, a text its longest word.
  const need = (cell, place) => {
    const text = cell.textContent.trim();
    const whole = cell.matches("td.n, th[scope=row]") || place === 0;
    const words = whole && text.length <= 30 ? [text] : text.split(/\s+/);
    return 1.5 + Math.max(2, ...words.map((word) => word.length));
  };

  const fit = (table) => {
    const widths = [];
    for (const row of table.rows) {
      [...row.cells].forEach((cell, place) => { widths[place] = Math.max(widths[place] || 0, need(cell, place)); });
    }
    // The first column stands in every block: it names the rows.
    const blocks = [[]];
    let size = widths[0];
    let largest = size;
    widths.slice(1).forEach((width, at) => {
      if (size + width > MOST && blocks[blocks.length - 1].length) {
        blocks.push([]);
        size = widths[0];
      }
      blocks[blocks.length - 1].push(at + 1);
      size += width;
      largest = Math.max(largest, size);
    });
    const type = `${Math.min(1, LINE / largest)}em`;
    undo.push(() => { table.style.fontSize = ""; });
    table.style.fontSize = type;
    if (blocks.length < 2) return;
    table.classList.add("split");
    undo.push(() => table.classList.remove("split"));
    for (const places of blocks.reverse()) {
      const part = table.cloneNode(true);
      part.classList.replace("split", "part");
      for (const row of part.rows) [...row.cells].forEach((cell, place) => { if (place && !places.includes(place)) cell.remove(); });
      table.after(part);
      undo.push(() => part.remove());
    }
  };

  // Paper is white and cannot be clicked: in light, all unfolded but long tables of numbers, which the file has.
  addEventListener("beforeprint", () => {
    before = root.dataset.theme;
    root.dataset.theme = "light";
    closed = [...document.querySelectorAll("details:not([open], .table, .index)")];
    for (const one of closed) one.open = true;
    for (const table of document.querySelectorAll("table")) if (!table.closest("details.table")) fit(table);
  });
  addEventListener("afterprint", () => {
    if (before) root.dataset.theme = before; else delete root.dataset.theme;
    for (const one of closed) one.open = false;
    for (const one of undo) one();
    undo = [];
  });
})();
