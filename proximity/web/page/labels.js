// Text in three dimensions: visible in a headset, on a screen, and in a picture.

import * as THREE from "three";

const HEIGHT = 44; // pixels of a line
const FONT = "600 34px system-ui, 'Segoe UI', Roboto, Arial, sans-serif";
const GAP = 2; // pixels between labels
const MAX_STEPS = 12;
const avoiding = new Set(); // labels that avoid each other

export class Label {
  /** *height* of a line in metres; flat ones are part of the floor, others have a dark background. */
  constructor({ height, isFlat = false, avoids = false }) {
    if (avoids) avoiding.add(this);
    this.height = height;
    this.isFlat = isFlat;
    this.shown = "";
    this.canvas = document.createElement("canvas");
    this.context = this.canvas.getContext("2d");
    this.texture = new THREE.CanvasTexture(this.canvas);
    this.texture.colorSpace = THREE.SRGBColorSpace;
    const material = new THREE.SpriteMaterial({ map: this.texture, transparent: true, depthWrite: false });
    material.depthTest = isFlat;
    material.toneMapped = false;
    this.object = new THREE.Sprite(material);
    this.object.renderOrder = isFlat ? 1 : 20;
    this.anchor(0.5, 0.5);
  }

  /** Set the anchor of the label, in shares of its size from its lower left corner. */
  anchor(x, y) {
    this.anchored = [x, y];
    this.object.center.set(x, y);
  }

  /** The label's rectangle, pixels, y up; null if its position is not visible. */
  covered(camera, width, height) {
    const { object } = this;
    for (let each = object; each; each = each.parent) if (!each.visible) return null;
    const at = object.getWorldPosition(new THREE.Vector3()).applyMatrix4(camera.matrixWorldInverse);
    const scale = height / (2 * Math.tan((camera.fov * Math.PI) / 360) * -at.z);
    const size = [object.scale.x * scale, object.scale.y * scale];
    at.applyMatrix4(camera.projectionMatrix);
    const place = [(0.5 + at.x / 2) * width, (0.5 + at.y / 2) * height];
    if (place.some((each, k) => !(each >= 0 && each <= [width, height][k]))) return null;
    const [left, bottom] = place.map((each, k) => each - this.anchored[k] * size[k]);
    return { label: this, size, place, left, bottom, right: left + size[0], top: bottom + size[1] };
  }

  /** Show lines of text; unchanged lines cost no time. */
  show(text, colour = "#f4f6f9", opacity = 1) {
    this.object.material.opacity = opacity;
    const key = `${text}|${colour}`;
    if (key === this.shown) return;
    this.shown = key;
    const rows = text.split("\n");
    const context = this.context;
    context.font = FONT;
    const pad = this.isFlat ? 4 : 14;
    const width = Math.ceil(Math.max(...rows.map((row) => context.measureText(row).width))) + 2 * pad;
    const height = HEIGHT * rows.length + (this.isFlat ? 0 : 8);
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
      this.texture.dispose();
    }
    context.clearRect(0, 0, width, height);
    if (!this.isFlat) {
      context.fillStyle = "rgba(17, 21, 28, 0.78)";
      context.beginPath();
      context.roundRect(0, 0, width, height, 10);
      context.fill();
    }
    context.font = FONT;
    context.textBaseline = "middle";
    rows.forEach((row, k) => {
      context.fillStyle = k ? "#b9c3d0" : colour;
      context.fillText(row, pad, HEIGHT * (k + 0.5) + (this.isFlat ? 0 : 5));
    });
    this.texture.needsUpdate = true;
    this.size = [width / HEIGHT, height / HEIGHT];
    this.setHeight(this.height);
  }

  /** Set the height of lines, m. */
  setHeight(height) {
    this.height = height;
    this.object.scale.set(height * this.size[0], height * this.size[1], 1);
  }
}

/** Shift labels that overlap, from above to below, and those cut off at the right. */
export function separate(camera, width, height) {
  const placed = [];
  for (const label of avoiding) if (!label.object.parent) avoiding.delete(label);
  const seen = [...avoiding].map((label) => label.covered(camera, width, height)).filter(Boolean);
  for (const each of seen.sort((a, b) => b.top - a.top)) {
    const shift = Math.min(width - GAP - each.right, 0);
    each.left += shift;
    each.right += shift;
    const covers = (other) => each.left < other.right && other.left < each.right && each.bottom < other.top && other.bottom < each.top;
    for (let step = 0, other; step < MAX_STEPS && (other = placed.find(covers)); step++) {
      each.top = other.bottom - GAP;
      each.bottom = each.top - each.size[1];
    }
    placed.push(each);
    each.label.object.center.set(...[each.left, each.bottom].map((low, k) => (each.place[k] - low) / each.size[k]));
  }
}
