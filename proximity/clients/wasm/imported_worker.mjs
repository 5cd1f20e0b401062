// The worker of imported.mjs: the engine, ten fingers, and the part that is imported. Ticks wait while a part is built.
import { load } from "proximity-engine";

const tips = Float64Array.from({ length: 30 }, (_, k) => [0.005 * k, 0, 0.05][k % 3]);
let part = null, nearest = Infinity, ticksLeft = 1000, next = performance.now();

const started = load().then((engine) => {
  const scene = engine.fromMesh("floor", [-1, -1, -0.2, 1, -1, -0.2, 0, 1, -0.2]);
  const tracker = scene.tracker(10);
  // A timer of a browser waits 4 ms; messages to oneself do not, and let those of the page through.
  const { port1, port2 } = new MessageChannel();
  port1.onmessage = () => {
    for (; next <= performance.now(); next += 1) tick(scene, tracker);
    port2.postMessage(null);
  };
  port2.postMessage(null);
  return scene;
});

function tick(scene, tracker) {
  const nowNs = BigInt(Math.round(1e6 * performance.now()));
  for (const contact of tracker.tick(tips, nowNs, nowNs)) {
    if (contact.part === part) nearest = Math.min(nearest, contact.signed_distance);
  }
  if (part !== null && --ticksLeft === 0) {
    scene.remove(part);
    part = null;
    postMessage({ result: `came within ${(1000 * nearest).toFixed(3)} mm of 'imported', now ${scene.parts.length} part` });
  }
}

self.onmessage = async ({ data: { vertices, matrix } }) => {
  const scene = await started;
  if (vertices) {
    part = scene.add("imported", vertices);
    ticksLeft = 1000;
    postMessage({ isAdded: true });
  } else if (part !== null) {
    scene.move([{ part, matrix }]);
  }
};
