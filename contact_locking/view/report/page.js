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
    const states = new Set([...body.rows].map((row) => row.dataset.state));
    // A table shows four digits, so that numbers that differ less look alike.
    const isNear = (a, b) => a === b
      || (Number.isFinite(a) && Math.abs(a - b) <= 5e-4 * Math.abs(a));
    const numberOf = (word) => {
      const text = word.replace("\u2212", "-").replace("\u221e", "Infinity").replace(/^\.?inf$/, "Infinity");
      return text === "" ? NaN : Number(text);
    };
    // A word that begins a state asks for the state, so that "converged" is not "not converged".
    const matches = (row, cells, word) => {
      if (word.length > 2 && [...states].some((state) => state.startsWith(word))) {
        return row.dataset.state.startsWith(word);
      }
      const wanted = numberOf(word);
      if (!Number.isNaN(wanted)) {
        return cells.some((cell) => "value" in cell.dataset
          ? isNear(Number(cell.dataset.value), wanted)
          : cell.textContent.toLowerCase().split(/[\s,;:()]+/).includes(word));
      }
      return cells.some((cell) => cell.textContent.toLowerCase().includes(word));
    };
    const apply = () => {
      const text = filter.value.toLowerCase().replace(/not\s+(converged|run)/g, "not-$1");
      const words = text.split(/\s+/).filter(Boolean);
      const seen = heads.map((head) => getComputedStyle(head).display !== "none");
      let visible = 0;
      for (const row of body.rows) {
        const cells = [...row.cells].filter((_, column) => seen[column]);
        row.hidden = !words.every((word) => matches(row, cells, word));
        visible += row.hidden ? 0 : 1;
      }
      count.textContent = `${visible} of ${body.rows.length} cases`;
    };
    filter.addEventListener("input", apply);
    const all = document.getElementById("all-columns");
    all.addEventListener("change", () => {
      table.classList.toggle("main", !all.checked);
      apply();
    });
    // A browser may fill in the fields of an earlier visit.
    table.classList.toggle("main", !all.checked);
    apply();
  }
  addEventListener("beforeprint", () => {
    // The reasons in the table of cases stay folded: a table on paper has one line for a case.
    for (const part of document.querySelectorAll("section > details")) part.open = true;
  });
})();
