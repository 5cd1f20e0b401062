// Colours of distances, whose order is preserved in grey.

/** The colour of a distance in metres, as red, green and blue from 0 to 1; dark is far, bright is near. */
const RAMP = [
  [0, [1.0, 0.86, 0.45]],
  [0.008, [0.78, 0.85, 0.42]],
  [0.02, [0.36, 0.72, 0.62]],
  [0.05, [0.2, 0.5, 0.68]],
  [0.12, [0.22, 0.32, 0.52]],
];
const INSIDE = [1.0, 0.42, 0.3];
export const GREY = [0.45, 0.47, 0.5];

export function distanceColour(distance) {
  if (Number.isNaN(distance) || distance === -Infinity) return GREY;
  return distance < 0 ? INSIDE : colourAt(RAMP, distance);
}

const SLICE = [
  [-1, [0.3, 0.03, 0.08]],
  [-0.35, [0.85, 0.4, 0.25]],
  [0, [1, 1, 1]],
  [0.25, [0.62, 0.82, 0.93]],
  [0.6, [0.24, 0.5, 0.72]],
  [1, [0.05, 0.14, 0.3]],
];

/** The colour of a signed distance on a slice, whose largest magnitude is *range*. */
export const sliceColour = (distance, range) => colourAt(SLICE, distance / range);

/** The colour at a position of a ramp: [position, colour], rising. */
function colourAt(ramp, x) {
  const k = ramp.findIndex(([place]) => x <= place);
  if (k <= 0) return ramp.at(k)[1];
  const [low, from] = ramp[k - 1], [high, to] = ramp[k];
  return mix(from, to, (x - low) / (high - low));
}

export const mix = (a, b, share) => a.map((value, k) => value + (b[k] - value) * share);

export const css = (colour) => `rgb(${colour.map((value) => Math.round(255 * value)).join(" ")})`;
