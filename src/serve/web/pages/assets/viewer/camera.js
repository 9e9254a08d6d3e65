// Where one looks from: a shot (what lies in the middle, from which side, how far away),
// the pinhole camera of it, and both in an address. The same as src/render/camera.rs.

const TAN_HALF = 0.364;

export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) =>
  [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const plus = (a, b, by = 1) => [a[0] + by * b[0], a[1] + by * b[1], a[2] + by * b[2]];

// The unit vector that points to an azimuth and an elevation.
export const direction = (azimuth, elevation) =>
  [Math.cos(azimuth) * Math.cos(elevation), Math.sin(azimuth) * Math.cos(elevation), Math.sin(elevation)];

// Pixels that a length of one covers at a distance of one.
export const focal = (width, height) => Math.min(width, height) / 2 / TAN_HALF;

// The camera of a shot.
export function cameraOf({ target, azimuth, elevation, distance }) {
  const outward = direction(azimuth, elevation);
  const eye = plus(target, outward, distance);
  const right = [-Math.sin(azimuth), Math.cos(azimuth), 0];
  const forward = outward.map(c => -c);
  return { eye, right, up: cross(right, forward), forward };
}

// A point as the camera sees it: to the right, up, and away from the eye.
export function viewOf(camera, point) {
  const d = plus(point, camera.eye, -1);
  return [dot(camera.right, d), dot(camera.up, d), dot(camera.forward, d)];
}

// Where a point lies in a picture, in pixels from the top left; nothing behind the eye.
export function pixelOf(camera, point, [width, height]) {
  const [x, y, away] = viewOf(camera, point);
  if (!(away > 0)) return null;
  const f = focal(width, height);
  return [width / 2 + x / away * f, height / 2 - y / away * f];
}

// The direction from the eye through a pixel; as long as it goes on by one into the picture.
export function rayOf(camera, [x, y], [width, height]) {
  const f = focal(width, height);
  return plus(plus(camera.forward, camera.right, (x - width / 2) / f), camera.up, (height / 2 - y) / f);
}

// The same place seen from another distance: `anchor` stays where it is in the picture.
export function zoomed(shot, anchor, factor) {
  const target = [0, 1, 2].map(i => anchor[i] + (shot.target[i] - anchor[i]) * factor);
  return { ...shot, target, distance: shot.distance * factor };
}

// Turned around the eye, which stays: one looks around.
export function looked(shot, turn, rise) {
  const { eye } = cameraOf(shot);
  const next = turned(shot, turn, rise);
  return { ...next, target: plus(eye, direction(next.azimuth, next.elevation), -shot.distance) };
}

// Turned around what lies in the middle.
export function turned(shot, turn, rise) {
  const steepest = Math.PI / 2;
  return {
    ...shot,
    azimuth: shot.azimuth + turn,
    elevation: Math.max(-steepest, Math.min(steepest, shot.elevation + rise)),
  };
}

// A shot between two, the shorter way around.
export function between(from, to, share) {
  const mix = (a, b) => a + (b - a) * share;
  const around = to.azimuth - from.azimuth;
  const shortest = around - 2 * Math.PI * Math.round(around / (2 * Math.PI));
  return {
    target: from.target.map((c, i) => mix(c, to.target[i])),
    azimuth: from.azimuth + shortest * share,
    elevation: mix(from.elevation, to.elevation),
    distance: from.distance * (to.distance / from.distance) ** share,
  };
}

// A shot in an address: target and distance in the octree's own units where they are many.
export function shotToText({ target, azimuth, elevation, distance }) {
  const digits = Math.max(0, Math.min(9, 4 - Math.floor(Math.log10(distance))));
  const number = (value, places) => String(Number(value.toFixed(places)));
  return [...target.map(c => number(c, digits)), number(azimuth, 5), number(elevation, 5), number(distance, digits)].join(',');
}

export function shotFromText(text) {
  const numbers = (text ?? '').split(',').map(Number);
  if (numbers.length !== 6 || !numbers.every(Number.isFinite) || !(numbers[5] > 0)) return null;
  const [x, y, z, azimuth, elevation, distance] = numbers;
  return { target: [x, y, z], azimuth, elevation: Math.max(-Math.PI / 2, Math.min(Math.PI / 2, elevation)), distance };
}
