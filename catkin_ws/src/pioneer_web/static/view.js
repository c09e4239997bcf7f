// Where the map is on the screen: its centre [m] and scale [pixels per metre].

const SMALLEST = 2;
const LARGEST = 400;
const PROBE = 400;  // size of the copy of the map in which its known part is looked for [pixels]

export const view = { x: 0, y: 0, scale: 0, follow: false };

export const canvas = () => document.getElementById("map");

/** The pixel of a place in the map's frame [m]. */
export function pixel(x, y) {
  const { clientWidth, clientHeight } = canvas();
  return [clientWidth / 2 + (x - view.x) * view.scale, clientHeight / 2 - (y - view.y) * view.scale];
}

/** The place in the map's frame [m] under a pixel. */
export function metre(u, v) {
  const { clientWidth, clientHeight } = canvas();
  return [view.x + (u - clientWidth / 2) / view.scale, view.y - (v - clientHeight / 2) / view.scale];
}

/** Zooms by a factor; the place under the pixel stays there. */
export function zoom(factor, u, v) {
  const [x, y] = metre(u, v);
  view.scale = Math.min(LARGEST, Math.max(SMALLEST, view.scale * factor));
  const [movedX, movedY] = metre(u, v);
  view.x += x - movedX;
  view.y += y - movedY;
}

/** Moves the map by pixels. */
export function pan(right, down) {
  view.x -= right / view.scale;
  view.y += down / view.scale;
  view.follow = false;
}

/** Shows the known part of the map, without the unknown area around it. */
export function fit(map, image) {
  if (!map || !image || !canvas().clientWidth) return;
  const known = knownPart(image);
  const width = known.width * map.width;
  const height = known.height * map.height;
  view.x = map.x + known.left * map.width + width / 2;
  view.y = map.y + map.height - known.top * map.height - height / 2;
  view.scale = 0.94 * Math.min(canvas().clientWidth / width, canvas().clientHeight / height);
}

/** The known part of a map's image, in parts of its size. Unknown cells are tinted, known ones grey. */
function knownPart(image) {
  const probe = document.createElement("canvas");
  probe.width = probe.height = PROBE;
  const context = probe.getContext("2d", { willReadFrequently: true });
  context.drawImage(image, 0, 0, PROBE, PROBE);
  const { data } = context.getImageData(0, 0, PROBE, PROBE);
  let [left, right, top, bottom] = [PROBE, -1, PROBE, -1];
  for (let row = 0; row < PROBE; row++) {
    for (let column = 0; column < PROBE; column++) {
      const at = 4 * (row * PROBE + column);
      const isUnknown = data[at] !== data[at + 2];
      if (isUnknown) continue;
      left = Math.min(left, column);
      right = Math.max(right, column);
      top = Math.min(top, row);
      bottom = Math.max(bottom, row);
    }
  }
  if (right < 0) return { left: 0, top: 0, width: 1, height: 1 };
  return {
    left: left / PROBE,
    top: top / PROBE,
    width: (right - left + 1) / PROBE,
    height: (bottom - top + 1) / PROBE,
  };
}
