// A part that the user imports while fingers are tracked, in a page that a bundler builds. Vite needs
// `worker: { format: "es" }` in vite.config.mjs. The page is:
//   <input type="file" id="part"> <output id="nearest"></output> <script type="module" src="imported.mjs"></script>
// This page reads the file (binary STL, in mm) and moves the part at 90 Hz. The worker adds the part, ticks ten fingers
// at 1 kHz, and removes it after a second.
const worker = new Worker(new URL("./imported_worker.mjs", import.meta.url), { type: "module" });
let mover = 0;

/** Vertices in m: nine numbers for each triangle. */
function readStl(bytes) {
  const view = new DataView(bytes), count = view.getUint32(80, true);
  return Float64Array.from({ length: 9 * count }, (_, k) =>
    view.getFloat32(84 + 50 * Math.floor(k / 9) + 12 + 4 * (k % 9), true) / 1000);
}

function startMoving() {
  let k = 0;
  mover = setInterval(() => {
    const cos = Math.cos(0.05 * k), sin = Math.sin(0.05 * k++);
    worker.postMessage({ matrix: [cos, -sin, 0, 0, sin, cos, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1] });
  }, 1000 / 90);
}

worker.onmessage = ({ data }) => {
  if (data.isAdded) {
    startMoving();
    return;
  }
  clearInterval(mover);
  document.getElementById("nearest").textContent = data.result;
};

document.getElementById("part").onchange = async ({ target }) => {
  const vertices = readStl(await target.files[0].arrayBuffer());
  worker.postMessage({ vertices }, [vertices.buffer]);
};
