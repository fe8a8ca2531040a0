// Script of the report: sorts tables by a column, filters them by policies and levels, and enlarges pictures.
// The ranking stays as it is.
// The page shows the same content without it.
"use strict";

/** Returns the number that a cell begins with, as in "8.30 ± 3.39", "83% [70, 92]", "1,234" or "< 0.01"; NaN for words. */
function leadingNumber(text) {
  const found = text.replace("−", "-").match(/^[<>≤≥≈~\s]*([-+]?(?:\d[\d,]*\.?\d*|\.\d+)(?:e[-+]?\d+)?)/i);
  return found ? Number(found[1].replaceAll(",", "")) : NaN;
}

const wordOf = (cell) => cell.textContent.trim();

/** Returns the rows of a table in groups that stay together: a row and the published rows that belong to it. */
function groupsOf(body) {
  const groups = [];
  for (const row of body.rows) {
    if (row.classList.contains("elsewhere") && groups.length) groups.at(-1).push(row);
    else groups.push([row]);
  }
  return groups;
}

/** Returns the groups sorted by a column: numbers by value, with words last in both directions; words alphabetically. */
function inOrder(groups, column, direction) {
  const keyed = groups.map((group) => {
    const word = wordOf(group[0].cells[column]);
    return { group, word, number: leadingNumber(word) };
  });
  const isNumber = ({ number }) => !Number.isNaN(number);
  const numeric = column === 0 ? keyed.every(isNumber) : keyed.some(isNumber);
  const compare = (one, other) => {
    if (!numeric) return direction * one.word.localeCompare(other.word, "en", { numeric: true });
    if (isNumber(one) && isNumber(other)) return direction * (one.number - other.number);
    return isNumber(other) - isNumber(one);
  };
  return keyed.sort(compare).map(({ group }) => group);
}

/** Adds a button to each heading that sorts the rows ascending, then descending, then in the original order. */
function makeSortable({ heads, body, groups }) {
  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const before = head.getAttribute("aria-sort");
      for (const other of heads) other.removeAttribute("aria-sort");
      if (before === "descending") {
        body.append(...groups.flat());
        return;
      }
      head.setAttribute("aria-sort", before ? "descending" : "ascending");
      body.append(...inOrder(groups, column, before ? -1 : 1).flat());
    });
  });
}

/** Finds the columns of a table that name policies or levels, and the columns that belong to one level each. */
function readTable(table, levels) {
  const heads = [...table.tHead.rows[0].cells];
  const columns = (pattern) => heads.flatMap((head, column) => (pattern.test(wordOf(head)) ? [column] : []));
  const levelOf = (head) => levels.find((level) => `${wordOf(head)} `.startsWith(`${level} `));
  const body = table.tBodies[0];
  return {
    table, heads, body, groups: groupsOf(body),
    policyColumns: columns(/^(policy|run)\b/i), levelColumns: columns(/^level\b/i), columnLevels: heads.map(levelOf),
  };
}

/** Shows the matching rows of a table; returns the number of shown rows and of all rows. */
function filterTable({ table, heads, groups, policyColumns, levelColumns, columnLevels }, policies, levels) {
  const matches = (text, words) => !words.length || words.some((word) => text.toLowerCase().includes(word));
  const matchesIn = (row, columns, words) =>
    !columns.length || columns.some((column) => matches(wordOf(row.cells[column]), words));
  const away = columnLevels.map((level) => level !== undefined && !matches(level, levels));
  const known = columnLevels.filter((level) => level !== undefined);
  const noLevel = known.length > 0 && !known.some((level) => matches(level, levels));
  heads.forEach((head, column) => { head.hidden = away[column]; });
  let shown = 0;
  for (const group of groups) {
    const [own] = group;
    const wanted = !noLevel && matchesIn(own, policyColumns, policies) && matchesIn(own, levelColumns, levels);
    for (const row of group) {
      row.hidden = !wanted;
      [...row.cells].forEach((cell, column) => { cell.hidden = away[column]; });
      shown += wanted;
    }
  }
  table.parentElement.classList.toggle("nothing", shown === 0);
  return [shown, groups.flat().length];
}

/** Filters the tables that name policies or levels by the words in the form, and shows the number of rows left. */
function makeFilter(form, tables) {
  const named = tables.filter(({ policyColumns, levelColumns }) => policyColumns.length || levelColumns.length);
  const words = (field) => field.value.toLowerCase().split(/[\s,]+/).filter(Boolean);
  const { policies, levels, count } = form.elements;
  const filter = () => {
    const counts = named.map((table) => filterTable(table, words(policies), words(levels)));
    const [shown, all] = [0, 1].map((place) => counts.reduce((sum, each) => sum + each[place], 0));
    count.value = shown === all ? `all ${all} rows are shown` : `${shown} of ${all} rows are shown`;
  };
  form.addEventListener("input", filter);
  form.addEventListener("submit", (event) => event.preventDefault());
  form.hidden = false;
  filter();
}

/** Adds a button under each picture that enlarges it for scrolling; the style shows the button on narrow screens. */
function makeLarger(picture) {
  const button = document.createElement("button");
  button.type = "button";
  button.className = "enlarge";
  const name = () => { button.textContent = picture.classList.contains("large") ? "Fit to the screen" : "Enlarge"; };
  button.addEventListener("click", () => { picture.classList.toggle("large"); name(); });
  name();
  picture.after(button);
}

const form = document.getElementById("filter");
const levels = JSON.parse(form.dataset.levels);
const tables = [...document.querySelectorAll(".wide > table")].map((table) => readTable(table, levels));
tables.forEach(makeSortable);
makeFilter(form, tables);
document.querySelectorAll(".picture").forEach(makeLarger);
