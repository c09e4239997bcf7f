// What has been wrong with the robots while a page was open: since when, until when.

import { escaped, values } from "./model.js";

export function showAlerts() {
  const alerts = values.alerts ?? [];
  const open = alerts.filter(alert => alert.until === null).length;
  document.getElementById("tab-alerts").textContent = open ? `Alerts (${open})` : "Alerts";
  const rows = alerts.toReversed().map(({ robot, what, since, until }) => `<tr class="${until === null ? "bad" : ""}">
    <td>${clock(since)}</td><td>${until === null ? "lasts" : clock(until)}</td><td>${escaped(robot)}</td><td>${escaped(what)}</td></tr>`);
  document.getElementById("alerts").innerHTML = rows.length
    ? `<table><tr><th>From</th><th>Until</th><th>Robot</th><th>What</th></tr>${rows.join("")}</table>`
    : "<p>Nothing has been wrong since a page was opened.</p>";
}

const clock = seconds => new Date(1000 * seconds).toLocaleTimeString("en-GB");
