// Text in three dimensions: seen in a headset as on a screen, and in a picture.

import * as THREE from "three";

const HEIGHT = 44; // pixels of a line
const FONT = "600 34px system-ui, 'Segoe UI', Roboto, Arial, sans-serif";

export class Label {
  /** *height* of a line in metres; flat ones are part of the floor, others have a dark ground. */
  constructor({ height, isFlat = false }) {
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
  }

  /** Show lines of text; the same again costs nothing. */
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

  /** Make lines as high as that, m. */
  setHeight(height) {
    this.height = height;
    this.object.scale.set(height * this.size[0], height * this.size[1], 1);
  }
}
