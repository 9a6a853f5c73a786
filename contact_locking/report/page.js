"use strict";
(() => {
  const table = document.getElementById("cases");
  if (table !== null) {
    const body = table.tBodies[0];
    const heads = [...table.tHead.rows[0].cells];
    const value = (row, column) => {
      const cell = row.cells[column];
      return "value" in cell.dataset ? Number(cell.dataset.value) : cell.textContent.trim();
    };
    // Numbers before texts, and what is missing last in either direction.
    const compare = (a, b, direction) => {
      const missing = (x) => x === "" || x === "\u2013";
      if (missing(a) || missing(b)) return missing(a) - missing(b);
      if (typeof a !== typeof b) return typeof a === "number" ? -1 : 1;
      if (a === b) return 0;
      const order = typeof a === "number" ? a - b : a.localeCompare(b, "en", { numeric: true });
      return direction * order;
    };
    heads.forEach((head, column) => {
      head.querySelector("button").addEventListener("click", () => {
        const direction = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
        heads.forEach((other) => other.removeAttribute("aria-sort"));
        head.setAttribute("aria-sort", direction > 0 ? "ascending" : "descending");
        const rows = [...body.rows];
        rows.sort((p, q) => compare(value(p, column), value(q, column), direction));
        body.append(...rows);
      });
    });
    const filter = document.getElementById("filter");
    const count = document.getElementById("count");
    const apply = () => {
      const words = filter.value.toLowerCase().split(/\s+/).filter(Boolean);
      let visible = 0;
      for (const row of body.rows) {
        const text = row.textContent.toLowerCase();
        row.hidden = !words.every((word) => text.includes(word));
        visible += row.hidden ? 0 : 1;
      }
      count.textContent = `${visible} of ${body.rows.length} cases`;
    };
    filter.addEventListener("input", apply);
    const all = document.getElementById("all-columns");
    all.addEventListener("change", () => table.classList.toggle("main", !all.checked));
    // A browser may fill in the fields of an earlier visit.
    table.classList.toggle("main", !all.checked);
    apply();
  }
  addEventListener("beforeprint", () => {
    for (const part of document.querySelectorAll("details")) part.open = true;
  });
})();
