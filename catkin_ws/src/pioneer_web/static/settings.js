// What the user has chosen, kept in the browser.

const KEY = "pioneer-fleet";
const DEFAULTS = {
  theme: "",
  tab: "robots",
  layers: { scan: true, costs: true, plans: true, trails: true, names: true, goals: true, objects: true },
  sort: { column: "", descending: false },
};

export const settings = { ...DEFAULTS, ...stored() };
settings.layers = { ...DEFAULTS.layers, ...settings.layers };

export function keep(changes) {
  Object.assign(settings, changes);
  try {
    localStorage.setItem(KEY, JSON.stringify(settings));
  } catch {
    // The browser stores nothing: the choice lasts until the page is closed.
  }
}

function stored() {
  try {
    return JSON.parse(localStorage.getItem(KEY)) ?? {};
  } catch {
    return {};
  }
}
