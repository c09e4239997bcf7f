// Windows above the page: a question, camera images, the doctor's findings.

import { escaped } from "./model.js";

const NEXT_IMAGE = 300;  // between two camera images [ms]

const dialog = () => document.getElementById("dialog");

/** Asks for a confirmation; returns whether it was given. */
export function confirmed(question, action) {
  show(`<p>${escaped(question)}</p><menu><button value="" class="outlined">Cancel</button>
    <button value="yes" class="outlined">${escaped(action)}</button></menu>`);
  return closed().then(answer => answer === "yes");
}

/** Shows live camera images until the window is closed. */
export async function showCameras() {
  const topics = await cameras();
  show(`<div class="camera"><select aria-label="Camera">${topics.map(topic => `<option>${escaped(topic)}</option>`).join("")}</select>
    <p>${topics.length ? "waiting for an image …" : "There are no camera images (sensor_msgs/Image) on this master."}</p>
    <img alt="Camera image" hidden><menu><button class="outlined">Close</button></menu></div>`);
  const end = closed();
  let isOpen = true;
  end.then(() => isOpen = false);
  const [choice, words, image] = ["select", "p", "img"].map(kind => dialog().querySelector(kind));
  choice.hidden = !topics.length;
  while (isOpen && topics.length) {
    await showImage(choice.value, words, image);
    await new Promise(done => setTimeout(done, NEXT_IMAGE));
  }
}

async function cameras() {
  try {
    return await (await fetch("/cameras")).json();
  } catch {
    return [];  // there is no connection, as the banner reports
  }
}

async function showImage(topic, words, image) {
  try {
    const answer = await fetch(`/camera?topic=${encodeURIComponent(topic)}`);
    if (!answer.ok) throw new Error(await answer.text());
    const before = image.src;
    image.src = URL.createObjectURL(await answer.blob());
    image.hidden = false;
    words.textContent = "";
    if (before) URL.revokeObjectURL(before);
  } catch (error) {
    words.textContent = error.message;
  }
}

/** Has the gateways examined, and shows what is wrong and how to mend it. */
export async function askDoctor() {
  show("<h2>What keeps gateways from working</h2><div>examining …</div><menu><button class=\"outlined\">Close</button></menu>");
  const findings = await examined();
  const lines = findings.map(({ level, what, fix }) =>
    `<p class="finding ${escaped(level)}">${escaped(level)}: ${escaped(what)}</p>${fix ? `<p class="fix">${escaped(fix)}</p>` : ""}`);
  const box = dialog().querySelector("div");
  if (box) box.innerHTML = lines.join("") || "<p class=\"finding\">Nothing is wrong.</p>";
}

async function examined() {
  try {
    const answer = await fetch("/doctor");
    if (!answer.ok) throw new Error(await answer.text());
    return await answer.json();
  } catch (error) {
    return [{ level: "fault", what: `the doctor does not answer: ${error.message}`, fix: "" }];
  }
}

function show(html) {
  dialog().close();
  dialog().innerHTML = `<form method="dialog">${html}</form>`;
  dialog().returnValue = "";
  dialog().showModal();
}

/** Waits until the window is closed; returns the value of the button. */
function closed() {
  return new Promise(done =>
    dialog().addEventListener("close", () => done(dialog().returnValue), { once: true }));
}
