// Six views of 90 degrees that see all directions, as glTF's axes have them: where each looks, and what is up in it.
export const VIEWS = [0, 1, 2, 3].map((k) => ({
  yaw: (k * Math.PI) / 2, pitch: 0, forward: [-Math.round(Math.sin((k * Math.PI) / 2)), 0, Math.round(Math.cos((k * Math.PI) / 2))],
  up: [0, 1, 0],
})).concat([
  { yaw: 0, pitch: -Math.PI / 2, forward: [0, 1, 0], up: [0, 0, -1] },
  { yaw: 0, pitch: Math.PI / 2, forward: [0, -1, 0], up: [0, 0, 1] },
]);
export const SIZE = 128;

// RGB of float pixels, row 0 at the bottom, as base64 with row 0 on top.
export function packed(rgba) {
  const rgb = new Float32Array(3 * SIZE * SIZE);
  for (let row = 0; row < SIZE; ++row) {
    for (let column = 0; column < SIZE; ++column) {
      const from = 4 * ((SIZE - 1 - row) * SIZE + column), to = 3 * (row * SIZE + column);
      rgb.set([rgba[from], rgba[from + 1], rgba[from + 2]], to);
    }
  }
  const bytes = new Uint8Array(rgb.buffer);
  let text = "";
  for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
  return btoa(text);
}

// Runs a job for each named file of jobs.json and leaves all results in the page, for --dump-dom.
export async function run(job) {
  const results = {};
  for (const name of await (await fetch("jobs.json")).json()) {
    try {
      results[name] = await job(name);
    } catch (error) {
      results[name] = { error: String(error.stack || error) };
    }
  }
  document.body.textContent = `RESULT${JSON.stringify(results)}END`;
}
