/* Tables of the class `sortable`: a click on a column's name sorts by it, empty cells last. */
"use strict";
(function () {
  function value(row, k) {
    const cell = row.cells[k], raw = cell ? (cell.dataset.v || cell.textContent.trim()) : "";
    if (raw === "" || raw === "\u2013") return null;
    const number = parseFloat(raw.replace("\u2212", "-").replace(/^[<>] /, ""));
    return isNaN(number) || !cell.classList.contains("n") ? raw.toLowerCase() : number;
  }
  for (const table of document.querySelectorAll("table.sortable")) {
    const body = table.tBodies[0], heads = Array.from(table.tHead.rows[0].cells), rows = Array.from(body.rows);
    const compare = new Intl.Collator("en", { numeric: true }).compare;
    heads.forEach(function (head, k) {
      const button = document.createElement("button");
      button.type = "button";
      button.append(...head.childNodes);
      head.replaceChildren(button);
      button.addEventListener("click", function () {
        const up = head.getAttribute("aria-sort") !== "ascending";
        heads.forEach(h => h.removeAttribute("aria-sort"));
        head.setAttribute("aria-sort", up ? "ascending" : "descending");
        const keyed = rows.map((row, n) => [value(row, k), n, row]);
        keyed.sort(function (a, b) {
          if (a[0] === null || b[0] === null) return (a[0] === null) - (b[0] === null) || a[1] - b[1];
          const both = typeof a[0] === "number" && typeof b[0] === "number";
          const order = both ? a[0] - b[0] : compare(a[0], b[0]);
          return (up ? order : -order) || a[1] - b[1];
        });
        body.append(...keyed.map(item => item[2]));
      });
    });
  }
})();
