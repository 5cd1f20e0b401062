// The stage: renderer, camera, light, grid. The scene's z is up; the browser's and the headset's y is.

import * as THREE from "three";
import { OrbitControls } from "./vendor/three/addons/controls/OrbitControls.js";
import { RoomEnvironment } from "./vendor/three/addons/environments/RoomEnvironment.js";
import { Label, separate } from "./labels.js";

const BACKGROUND = 0x252c36;
const FOV = 38;
const BEFORE = 0.3; // m from the eyes to the nearest side of the parts, in a headset
const BELOW = 0.3; // m from the eyes down to the bottom of the parts
const SLOW_MS = 50; // to draw a picture; from here on fewer pixels are drawn
const FAST_MS = 34;
const REST = 3;
const MAX_REST_MS = 1500;
const AWAKE_MS = 600; // of consecutive pictures after a change
const IDLE_MS = 250; // between two pictures without changes

export class Stage {
  constructor(canvas) {
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, stencil: true, preserveDrawingBuffer: false });
    this.renderer.toneMapping = THREE.AgXToneMapping;
    this.renderer.toneMappingExposure = 1.0;
    this.renderer.localClippingEnabled = true;
    this.renderer.xr.enabled = true;
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color(BACKGROUND);
    const pmrem = new THREE.PMREMGenerator(this.renderer);
    this.scene.environment = pmrem.fromScene(new RoomEnvironment(), 0.04).texture;
    this.scene.environmentIntensity = 0.5;
    pmrem.dispose();
    this.camera = new THREE.PerspectiveCamera(FOV, 1, 0.001, 100);
    const key = new THREE.DirectionalLight(0xfff4e6, 1.9);
    key.position.set(0.6, 1.4, 0.9);
    const rim = new THREE.DirectionalLight(0xbfd4ff, 0.6);
    rim.position.set(-1, 0.5, -1);
    this.scene.add(key, rim);
    this.root = new THREE.Group(); // contains all objects in the scene's frame
    this.root.rotation.x = -Math.PI / 2;
    this.scene.add(this.root);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = false;
    this.box = new THREE.Box3(new THREE.Vector3(-0.05, -0.05, 0), new THREE.Vector3(0.05, 0.05, 0.05));
    this.grid = new THREE.Group();
    this.root.add(this.grid);
    this.ratio = Math.min(devicePixelRatio, 2);
    this.drawMs = 16; // duration of a picture
    this.lastMs = 0; // beginning of the last picture
    this.fence = null; // of the picture that is timed, since fenceMs
    this.fenceMs = 0;
    this.awakeMs = 0; // end of consecutive pictures
    this.updates = new Set(); // called before each picture
    this.takers = new Set(); // called with each frame of a headset, drawn or not
    addEventListener("resize", () => this.resized());
    for (const name of ["pointermove", "pointerdown", "wheel", "keydown", "click", "input", "resize"]) addEventListener(name, () => this.wake(), true);
    this.resize();
    this.home();
    this.renderer.setAnimationLoop((time, xrFrame) => this.draw(time, xrFrame));
  }

  get radius() {
    return Math.max(this.box.getSize(new THREE.Vector3()).length() / 2, 1e-4);
  }

  resize() {
    if (this.renderer.xr.isPresenting) return;
    const { innerWidth: width, innerHeight: height } = window;
    this.renderer.setPixelRatio(this.ratio);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
  }

  resized() {
    this.resize();
    this.renderer.render(this.scene, this.camera);
  }

  draw(time, xrFrame) {
    if (xrFrame) for (const take of this.takers) take(xrFrame);
    if (!xrFrame && this.rests(time)) return;
    this.adapt(); // before drawing: a canvas of another size is empty
    for (const update of this.updates) update();
    if (!this.renderer.xr.isPresenting) {
      this.controls.update();
      separate(this.camera, innerWidth, innerHeight);
    }
    this.renderer.render(this.scene, this.camera);
    if (xrFrame || this.fence) return;
    const gl = this.renderer.getContext();
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    this.fenceMs = time;
  }

  /**
   * Whether to skip a picture now: slow pictures, without a graphics card, leave two thirds of the time to the service;
   * and without changes few are drawn.
   */
  rests(time) {
    if (this.isBusy(time)) return true;
    const pause = this.drawMs < SLOW_MS ? 0 : Math.min(REST * this.drawMs, MAX_REST_MS);
    if (time - this.lastMs < Math.max(pause, time < this.awakeMs ? 0 : IDLE_MS)) return true;
    this.lastMs = time;
    return false;
  }

  /** Whether a slow picture is still being drawn, which happens beside this program; times those that have ended. */
  isBusy(time) {
    if (!this.fence) return false;
    const gl = this.renderer.getContext(), tookMs = time - this.fenceMs;
    if (gl.getSyncParameter(this.fence, gl.SYNC_STATUS) !== gl.SIGNALED && !gl.isContextLost()) return tookMs > SLOW_MS;
    gl.deleteSync(this.fence);
    this.fence = null;
    this.drawMs += 0.3 * (Math.min(tookMs, 1000) - this.drawMs);
    return false;
  }

  /** A visible change has happened. */
  wake() {
    this.awakeMs = performance.now() + AWAKE_MS;
  }

  /** Draw fewer pixels when pictures are slow, and more again when they are not. */
  adapt() {
    if (this.renderer.xr.isPresenting) return;
    const most = Math.min(devicePixelRatio, 2);
    let ratio = this.ratio;
    if (this.drawMs > SLOW_MS) ratio = Math.max(ratio * 0.7, 0.5 * most);
    else if (this.drawMs < FAST_MS) ratio = Math.min(ratio * 1.2, most);
    if (Math.abs(ratio - this.ratio) < 1e-3) return;
    this.ratio = ratio;
    this.drawMs = (SLOW_MS + FAST_MS) / 2; // measure again before the next change
    this.resize();
  }

  /** Set the bounds of the scene: view, grid and depth follow. */
  setBounds(box) {
    this.box = box;
    this.camera.near = this.radius * 0.01;
    this.camera.far = this.radius * 400;
    this.camera.updateProjectionMatrix();
    this.makeGrid();
    this.home();
  }

  /** View the whole scene from above and the front. */
  home() {
    this.frame(this.box, new THREE.Vector3(0.55, 0.55, 0.8));
  }

  /** View a box, scene frame, from a direction; by default the present one. */
  frame(box, from = this.camera.position.clone().sub(this.controls.target)) {
    const centre = this.toWorld(box.getCenter(new THREE.Vector3()));
    const radius = Math.max(box.getSize(new THREE.Vector3()).length() / 2, 1e-4);
    const away = (1.35 * radius) / Math.sin(THREE.MathUtils.degToRad(FOV / 2)) / Math.min(this.camera.aspect, 1);
    this.look(centre.clone().addScaledVector(from.normalize(), away), centre);
  }

  look(eye, at) {
    this.camera.position.copy(eye);
    this.controls.target.copy(at);
    this.controls.update();
    this.wake();
  }

  zoom(factor) {
    this.camera.position.sub(this.controls.target).multiplyScalar(factor).add(this.controls.target);
  }

  toWorld(point) {
    this.root.updateMatrixWorld(true);
    return point.clone().applyMatrix4(this.root.matrixWorld);
  }

  toScene(point) {
    this.root.updateMatrixWorld(true);
    return point.clone().applyMatrix4(this.root.matrixWorld.clone().invert());
  }

  /** Place the parts in front of these eyes, upright and at their true size. */
  putBefore(eyes, towards) {
    const level = new THREE.Vector3(towards.x, 0, towards.z).normalize();
    this.putBack();
    this.root.rotation.set(-Math.PI / 2, 0, Math.atan2(-level.x, -level.z));
    const centre = this.box.getCenter(new THREE.Vector3());
    const foot = this.toWorld(new THREE.Vector3(centre.x, centre.y, this.box.min.z));
    const place = eyes.clone().addScaledVector(level, BEFORE + this.radius);
    place.y -= BELOW;
    this.root.position.copy(place.sub(foot));
    this.root.updateMatrixWorld(true);
  }

  /** Place the parts for a screen. */
  putBack() {
    this.root.position.set(0, 0, 0);
    this.root.rotation.set(-Math.PI / 2, 0, 0);
    this.root.updateMatrixWorld(true);
  }

  /** Lines in millimetres on the floor, finer ones between, and numbers at the coarse ones. */
  makeGrid() {
    for (const child of [...this.grid.children]) this.grid.remove(child);
    const centre = this.box.getCenter(new THREE.Vector3());
    const floor = this.box.min.z - 0.002 * this.radius;
    const reach = 3 * this.radius;
    this.spacing = niceStep(this.radius / 2.2);
    const fine = this.spacing / 5;
    this.grid.add(lines(centre, floor, reach, fine, 0.16), lines(centre, floor, reach, this.spacing, 0.42));
    const last = (value) => Math.floor(value / this.spacing) * this.spacing;
    const size = 0.055 * this.radius;
    for (let x = -last(1.6 * this.radius - centre.x); x <= centre.x + 1.6 * this.radius; x += this.spacing) {
      this.addNumber(x, x, last(this.box.min.y - 0.45 * this.radius), floor, size);
    }
    for (let y = -last(1.6 * this.radius - centre.y); y <= centre.y + 1.6 * this.radius; y += this.spacing) {
      this.addNumber(y, last(this.box.max.x + 0.45 * this.radius) + this.spacing, y, floor, size);
    }
    this.grid.add(axes(this.box, floor, this.radius));
  }

  addNumber(value, x, y, floor, size) {
    const label = new Label({ height: size, isFlat: true });
    label.show(`${+(1e3 * this.spacing * Math.round(value / this.spacing)).toPrecision(6)}`.replace("-", "−"), "#8d9aab");
    label.object.position.set(x, y, floor);
    this.grid.add(label.object);
  }

  /** The present view, with every pixel of the screen, as a Blob; *paint* draws over it, in CSS pixels. */
  async picture(paint) {
    const { ratio } = this;
    this.ratio = devicePixelRatio;
    this.resized();
    const sheet = document.createElement("canvas"), context = sheet.getContext("2d");
    [sheet.width, sheet.height] = [this.canvas.width, this.canvas.height];
    context.drawImage(this.canvas, 0, 0);
    context.scale(devicePixelRatio, devicePixelRatio);
    paint(context);
    this.ratio = ratio;
    this.resized();
    return new Promise((resolve) => sheet.toBlob(resolve, "image/png"));
  }
}

/** The nearest of 1, 2 and 5 times a power of ten. */
export function niceStep(length) {
  const power = 10 ** Math.floor(Math.log10(length));
  const share = length / power;
  return power * (share < 1.5 ? 1 : share < 3.5 ? 2 : share < 7.5 ? 5 : 10);
}

function lines(centre, floor, reach, spacing, opacity) {
  const [positions, colours] = [[], []];
  const pieces = 24;
  const point = (x, y) => {
    positions.push(x, y, floor);
    const far = Math.hypot(x - centre.x, y - centre.y) / reach;
    colours.push(0.62, 0.7, 0.8, opacity * Math.max(0, 1 - far * far));
  };
  const begin = (value) => Math.ceil((value - reach) / spacing) * spacing;
  for (let k = 0; k <= (2 * reach) / spacing; k++) {
    const [x, y] = [begin(centre.x) + k * spacing, begin(centre.y) + k * spacing];
    for (let i = 0; i < pieces; i++) {
      const [from, to] = [reach * ((2 * i) / pieces - 1), reach * ((2 * i + 2) / pieces - 1)];
      point(x, centre.y + from);
      point(x, centre.y + to);
      point(centre.x + from, y);
      point(centre.x + to, y);
    }
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(positions, 3));
  geometry.setAttribute("color", new THREE.Float32BufferAttribute(colours, 4));
  const material = new THREE.LineBasicMaterial({ vertexColors: true, transparent: true, depthWrite: false });
  return new THREE.LineSegments(geometry, material);
}

/** Axes x, y and z next to the part, with their letters. */
function axes(box, floor, radius) {
  const group = new THREE.Group();
  const length = 0.28 * radius;
  group.position.set(box.min.x - 0.35 * radius, box.min.y - 0.35 * radius, floor);
  const shown = [["x", [1, 0, 0], 0xe0786a], ["y", [0, 1, 0], 0x86c28b], ["z", [0, 0, 1], 0x7fa8e6]];
  for (const [name, direction, colour] of shown) {
    const towards = new THREE.Vector3(...direction);
    group.add(new THREE.ArrowHelper(towards, new THREE.Vector3(), length, colour, 0.25 * length, 0.12 * length));
    const label = new Label({ height: 0.075 * radius });
    label.show(name, `#${colour.toString(16)}`);
    label.object.position.copy(towards.multiplyScalar(1.25 * length));
    group.add(label.object);
  }
  return group;
}
