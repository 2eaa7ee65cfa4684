"use strict";
for (const block of document.querySelectorAll(".cells")) {
  const body = block.querySelector("tbody"), rows = [...body.rows], titles = [...block.querySelectorAll("th")];
  const filter = block.querySelector("input[type=search]"), onlyOk = block.querySelector(".only-ok"), count = block.querySelector("output");

  // Numbers by their key, words by themselves; what is unknown comes last in both directions.
  const key = (row, column) => {
    const cell = row.cells[column], number = cell.dataset.key;
    return number !== undefined ? Number(number) : cell.textContent.trim() || null;
  };
  const compare = (a, b) =>
    typeof a === "number" && typeof b === "number" ? a - b : String(a).localeCompare(String(b), "en", { numeric: true });

  titles.forEach((title, column) => title.firstElementChild.addEventListener("click", () => {
    const up = title.getAttribute("aria-sort") !== "ascending";
    titles.forEach((other) => other.setAttribute("aria-sort", "none"));
    title.setAttribute("aria-sort", up ? "ascending" : "descending");
    const keyed = rows.map((row, place) => ({ row, place, key: key(row, column) }));
    keyed.sort((a, b) => {
      if (a.key === null || b.key === null) return (a.key === null) - (b.key === null) || a.place - b.place;
      return (up ? 1 : -1) * compare(a.key, b.key) || a.place - b.place;
    });
    body.append(...keyed.map((entry) => entry.row));
  }));

  const show = () => {
    const words = filter.value.toLowerCase().split(/\s+/).filter(Boolean);
    let shown = 0;
    for (const row of rows) {
      const text = row.textContent.toLowerCase();
      row.hidden = (onlyOk.checked && row.dataset.status !== "ok") || !words.every((word) => text.includes(word));
      shown += !row.hidden;
    }
    count.textContent = `${shown} of ${rows.length} rows`;
  };
  filter.addEventListener("input", show);
  onlyOk.addEventListener("change", show);
  show();
}
