// Tables of the leaderboard that sort by a column when its head is pressed.
"use strict";

/** Return the first number of a cell, or its text in small letters; of a cell without a value nothing. */
function sortKey(cell) {
  const text = cell.textContent.trim();
  if (text === "" || text === "missing") return null;
  const number = text.replaceAll(",", "").match(/^-?\d+(\.\d+)?/);
  return number ? Number(number[0]) : text.toLowerCase();
}

/** Compare two keys: numbers before texts, nothing always last. */
function compareKeys(a, b, direction) {
  if (a === null || b === null) return (a === null) - (b === null);
  if (typeof a !== typeof b) return typeof a === "number" ? -1 : 1;
  return direction * (typeof a === "number" ? a - b : a.localeCompare(b));
}

/** Sort the rows of a table by a column; the first press puts large numbers and early letters first. */
function sortBy(table, column) {
  const head = table.tHead.rows[0].cells[column];
  const rows = [...table.tBodies[0].rows];
  const numeric = rows.some((row) => typeof sortKey(row.cells[column]) === "number");
  const before = head.getAttribute("aria-sort");
  const descending = before === "none" ? numeric : before === "ascending";
  for (const cell of table.tHead.rows[0].cells) cell.setAttribute("aria-sort", "none");
  head.setAttribute("aria-sort", descending ? "descending" : "ascending");
  const direction = descending ? -1 : 1;
  rows.sort((a, b) => compareKeys(sortKey(a.cells[column]), sortKey(b.cells[column]), direction));
  table.tBodies[0].append(...rows);
}

/** Put a button into each head of a table. */
function makeSortable(table) {
  [...table.tHead.rows[0].cells].forEach((cell, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...cell.childNodes);
    button.addEventListener("click", () => sortBy(table, column));
    cell.setAttribute("aria-sort", "none");
    cell.append(button);
  });
}

document.addEventListener("DOMContentLoaded", () => {
  if (!location.pathname.endsWith("/leaderboard.html")) return;
  document.querySelectorAll("article table").forEach((table) => table.tHead && makeSortable(table));
});
