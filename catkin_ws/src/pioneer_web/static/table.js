// The table of the robots.

import { lostFor } from "./connection.js";
import { colourOf, escaped, isSelected, robotNames, rowOf, values } from "./model.js";
import { keep, settings } from "./settings.js";

/** Name, value to sort by, and HTML of each column; wide ones are left out on a phone, optional ones without values. */
const COLUMNS = [
  { name: "Robot", key: robot => robot, html: nameCell },
  { name: "State", key: stateOf, html: robot => escaped(stateOf(robot)), class: stateClass },
  { name: "m/s", key: robot => rowOf(robot).speed, html: robot => (rowOf(robot).speed ?? 0).toFixed(2) },
  { name: "± m", key: robot => rowOf(robot).deviation, html: robot => digits(rowOf(robot).deviation, 2) },
  { name: "Goals", key: robot => rowOf(robot).reached, html: goalsCell },
  { name: "Odom", wide: true, key: robot => rowOf(robot).odom, html: robot => seconds(rowOf(robot).odom) },
  { name: "Scan", wide: true, key: robot => rowOf(robot).scan, html: robot => seconds(rowOf(robot).scan) },
  { name: "Rules", wide: true, key: robot => linkOf(robot)?.active, html: rulesCell },
  { name: "CPU", wide: true, key: robot => rowOf(robot).load?.[0], html: loadCell, class: () => "load" },
  { name: "Battery", wide: true, optional: true, key: robot => rowOf(robot).battery, html: batteryCell },
  { name: "Last word", wide: true, key: robot => rowOf(robot).waypoint, html: robot => escaped(rowOf(robot).waypoint) },
];

export function showTable() {
  const robots = sorted(robotNames());
  const columns = COLUMNS.filter(column => !column.optional || robots.some(robot => column.key(robot) != null));
  const body = robots.map(robot => {
    const cells = columns.map(column => {
      const classes = [column.wide ? "wide" : "", column.class?.(robot) ?? ""].join(" ").trim();
      return `<td class="${classes}">${column.html(robot)}</td>`;
    });
    const chosen = isSelected(robot);
    return `<tr data-robot="${escaped(robot)}" class="${chosen ? "selected" : ""}" aria-selected="${chosen}">${cells.join("")}</tr>`;
  });
  const element = document.getElementById("robots");
  // A button that has the focus must not lose it by an update.
  const focused = element.contains(document.activeElement) ? document.activeElement.dataset.sort : undefined;
  element.innerHTML = `<table><thead><tr>${columns.map(head).join("")}</tr></thead><tbody>${body.join("")}</tbody></table>`;
  if (focused) element.querySelector(`[data-sort="${focused}"]`)?.focus();
}

/** Sorts by a column; a second time, the other way round; a third time, as the computers are numbered. */
export function sortBy(column) {
  const { sort } = settings;
  if (sort.column !== column) keep({ sort: { column, descending: false } });
  else if (!sort.descending) keep({ sort: { column, descending: true } });
  else keep({ sort: { column: "", descending: false } });
  showTable();
}

function head(column) {
  const { sort } = settings;
  const isSorted = sort.column === column.name;
  const arrow = isSorted ? sort.descending ? " ▼" : " ▲" : "";
  const order = isSorted ? sort.descending ? "descending" : "ascending" : "none";
  return `<th class="${column.wide ? "wide" : ""}" aria-sort="${order}"><button data-sort="${column.name}">${column.name}${arrow}</button></th>`;
}

function sorted(robots) {
  const column = COLUMNS.find(one => one.name === settings.sort.column);
  if (!column) return robots;
  const compare = new Intl.Collator("en", { numeric: true }).compare;
  const found = robots.toSorted((a, b) => compare(String(column.key(a) ?? ""), String(column.key(b) ?? "")));
  return settings.sort.descending ? found.reverse() : found;
}

/** The robot's state, or what is wrong with it, in words. */
export function stateOf(robot) {
  const row = rowOf(robot);
  if (row.held) return "stopped, held";
  if (row.fault) return row.fault;
  return row.patrols ? `${row.state}, patrol` : row.state;
}

function stateClass(robot) {
  const { fault, held, trouble } = rowOf(robot);
  return fault || held || trouble ? "bad" : "";
}

function nameCell(robot) {
  return `<i style="background:${colourOf(robot)}"></i>${escaped(robot)}`;
}

function goalsCell(robot) {
  const { reached, received } = rowOf(robot);
  return `${reached ?? 0}/${received ?? 0}`;
}

function rulesCell(robot) {
  const link = linkOf(robot);
  return link ? `${link.active}/${link.rules}` : "–";
}

function loadCell(robot) {
  const { load } = rowOf(robot);
  return load ? `${load[0].toFixed(2)}<br>${load[1]} MiB` : "–";
}

function batteryCell(robot) {
  const { battery } = rowOf(robot);
  return battery == null ? "–" : `${Math.round(100 * battery)} %`;
}

function linkOf(robot) {
  return Object.values(values.network ?? {}).find(link => link.robot === robot);
}

const digits = (value, count) => value == null ? "–" : value.toFixed(count);

/** An age, which also grows while there is no connection. */
const seconds = age => age == null ? "none" : `${(age + lostFor()).toFixed(1)} s`;
