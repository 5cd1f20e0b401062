// Colours that say how far, and stay in order when seen in grey.

/** What a distance in metres looks like, as red, green and blue from 0 to 1; dark is far, bright is near. */
const RAMP = [
  [0.12, [0.22, 0.32, 0.52]],
  [0.05, [0.2, 0.5, 0.68]],
  [0.02, [0.36, 0.72, 0.62]],
  [0.008, [0.78, 0.85, 0.42]],
  [0.0, [1.0, 0.86, 0.45]],
];
const INSIDE = [1.0, 0.42, 0.3];
export const GREY = [0.45, 0.47, 0.5];

export function distanceColour(distance) {
  if (!Number.isFinite(distance)) return distance === Infinity ? RAMP[0][1] : GREY;
  if (distance < 0) return INSIDE;
  for (let k = 1; k < RAMP.length; k++) {
    const [far, farColour] = RAMP[k - 1];
    const [near, nearColour] = RAMP[k];
    if (distance >= near) return mix(nearColour, farColour, Math.min((distance - near) / (far - near), 1));
  }
  return RAMP.at(-1)[1];
}

const SLICE = [
  [-1, [0.3, 0.03, 0.08]],
  [-0.35, [0.85, 0.4, 0.25]],
  [0, [1, 1, 1]],
  [0.25, [0.62, 0.82, 0.93]],
  [0.6, [0.24, 0.5, 0.72]],
  [1, [0.05, 0.14, 0.3]],
];

/** The colour of a signed distance on a slice, whose largest size is *range*. */
export function sliceColour(distance, range) {
  const x = Math.max(-1, Math.min(1, distance / range));
  for (let k = 1; k < SLICE.length; k++) {
    if (x <= SLICE[k][0]) {
      const [low, lowColour] = SLICE[k - 1];
      return mix(lowColour, SLICE[k][1], (x - low) / (SLICE[k][0] - low));
    }
  }
  return SLICE.at(-1)[1];
}

export const mix = (a, b, share) => a.map((value, k) => value + (b[k] - value) * share);

export const css = (colour) => `rgb(${colour.map((value) => Math.round(255 * value)).join(" ")})`;
