// Reads exported light without any library.

// Decodes a Radiance .hdr without run-length coding, as fastibl writes it: {width, height, data}, three floats per
// pixel.
export function decodeHdr(buffer) {
  const bytes = new Uint8Array(buffer);
  let begin = 0;
  const line = () => {
    const end = bytes.indexOf(10, begin);
    if (end < 0) throw new Error("the picture ends within its header");
    const text = String.fromCharCode(...bytes.subarray(begin, end));
    begin = end + 1;
    return text;
  };
  if (!line().startsWith("#?")) throw new Error("not a Radiance picture");
  while (line() !== "");
  const [, height, width] = line().match(/^-Y (\d+) \+X (\d+)$/).map(Number);
  if (bytes.length - begin !== 4 * width * height) throw new Error("expected a picture without run-length coding");
  const data = new Float32Array(3 * width * height);
  for (let i = 0; i < width * height; ++i) {
    const scale = 2 ** (bytes[begin + 4 * i + 3] - 136);
    for (let c = 0; c < 3; ++c) data[3 * i + c] = bytes[begin + 4 * i + c] * scale;
  }
  return { width, height, data };
}

// The irradiance for a unit normal, from the nine coefficients of light.json (sh9.radiance).
export function shIrradiance(sh, [x, y, z]) {
  const basis = [
    0.282095, 0.488603 * y, 0.488603 * z, 0.488603 * x, 1.092548 * x * y, 1.092548 * y * z,
    0.315392 * (3 * z * z - 1), 1.092548 * x * z, 0.546274 * (x * x - y * y),
  ];
  const cosine = [Math.PI, 2.0943951, 2.0943951, 2.0943951, 0.785398, 0.785398, 0.785398, 0.785398, 0.785398];
  return [0, 1, 2].map((c) => sh.reduce((sum, value, i) => sum + value[c] * basis[i] * cosine[i], 0));
}

// The texel of a strip of faces that is nearest to a direction, as a GPU finds it.
export function lookUp({ width: n, data }, [x, y, z]) {
  const [ax, ay, az] = [Math.abs(x), Math.abs(y), Math.abs(z)];
  let face, s, t, major;
  if (ax >= ay && ax >= az) [face, s, t, major] = x > 0 ? [0, -z, -y, ax] : [1, z, -y, ax];
  else if (ay >= az) [face, s, t, major] = y > 0 ? [2, x, z, ay] : [3, x, -z, ay];
  else [face, s, t, major] = z > 0 ? [4, x, -y, az] : [5, -x, -y, az];
  const column = Math.min(n - 1, Math.floor((s / major + 1) / 2 * n));
  const row = Math.min(n - 1, Math.floor((t / major + 1) / 2 * n));
  const i = 3 * ((face * n + row) * n + column);
  return [data[i], data[i + 1], data[i + 2]];
}
