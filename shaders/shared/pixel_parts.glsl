// The triangles that a pixel's four samples show, one part of the pixel after the other. Needs shared/projection.glsl.
uniform usampler2D visible;       // number of a triangle; each of the four samples has a channel
uniform ivec2 corner;             // first pixel of the area that is drawn
uniform isampler2D triangles;     // vertices of each triangle, and the number of the one that it is a part of, or 0
uniform sampler2D vertices;       // position and normal, one vertex after the other
uniform sampler2D shares;         // the shares of the irradiance (RGB) and of the glossy light that reach a vertex
uniform int backs;                // where the shares of the vertices' backs begin; 0: there are none
uniform float curved_cosine;      // between normals: below it, a triangle is shaded at each of its samples

ivec2 texel(int i) { return ivec2(i & 1023, i >> 10); }
float edge(vec2 a, vec2 b) { return a.x * b.y - a.y * b.x; }  // from a to b, seen from the origin

// Weights of a triangle's corners at a point of the picture, perspective-correct.
vec3 corner_weights(vec3 pa, vec3 pb, vec3 pc, vec2 p) {
  float area = edge(pb.xy - pa.xy, pc.xy - pa.xy);
  vec3 w = vec3(edge(pb.xy - p, pc.xy - p) / area, edge(pc.xy - p, pa.xy - p) / area, 0.0);
  w.z = 1.0 - w.x - w.y;
  w /= vec3(pa.z, pb.z, pc.z);
  return w / (w.x + w.y + w.z);
}

// Places of the four samples in a pixel, in 256ths.
const vec4 kSampleX = vec4(96.0, 224.0, 32.0, 160.0), kSampleY = vec4(32.0, 96.0, 160.0, 224.0);

// Whether a triangle's normals, at the samples of a pixel that it covers, differ by much of the lobe's width.
bool is_curved(mat3 n, vec3 pa, vec3 pb, vec3 pc, vec2 pixel, bvec4 same) {
  if (min(min(dot(n[0], n[1]), dot(n[1], n[2])), dot(n[2], n[0])) >= curved_cosine) return false;
  vec3 at[4];
  for (int k = 0; k < 4; ++k) {
    if (!same[k]) continue;
    vec2 sample_at = pixel + vec2(kSampleX[k], kSampleY[k]) / 256.0;
    at[k] = normalize(n * corner_weights(pa, pb, pc, sample_at));
    for (int j = 0; j < k; ++j)
      if (same[j] && dot(at[j], at[k]) < curved_cosine) return true;
  }
  return false;
}

// One triangle's part of a pixel, in the object's frame.
struct Part {
  int triangle, first;  // number; its first sample
  float count;          // of its samples
  ivec3 index;          // of its corners
  vec3 a, b, c;         // their positions,
  mat3 normals;
  vec3 pa, pb, pc;      // and projections
  vec2 p;               // the middle of its samples, in the picture
  vec3 w;               // weights of the corners there
  bool behind;          // seen from inside
};

// Takes the next part from the samples that are `left`, of which there is at least one. A part is a triangle, or one of
// its samples where it is curved.
Part next_part(uvec4 shown, ivec2 pixel, inout bvec4 left) {
  Part part;
  part.first = left.x ? 0 : left.y ? 1 : left.z ? 2 : 3;
  uint number = shown[part.first];
  bvec4 same = equal(shown, uvec4(number));
  vec4 weight = vec4(same);
  part.count = weight.x + weight.y + weight.z + weight.w;
  vec2 middle = vec2(dot(weight, kSampleX), dot(weight, kSampleY));
  part.p = vec2(pixel) + floor(middle / part.count) / 256.0;
  part.triangle = int(number);

  part.index = texelFetch(triangles, texel(part.triangle - 1), 0).xyz;
  part.a = texelFetch(vertices, texel(2 * part.index.x), 0).xyz;
  part.b = texelFetch(vertices, texel(2 * part.index.y), 0).xyz;
  part.c = texelFetch(vertices, texel(2 * part.index.z), 0).xyz;
  part.pa = project(part.a);
  part.pb = project(part.b);
  part.pc = project(part.c);
  part.normals = mat3(texelFetch(vertices, texel(2 * part.index.x + 1), 0).xyz,
                      texelFetch(vertices, texel(2 * part.index.y + 1), 0).xyz,
                      texelFetch(vertices, texel(2 * part.index.z + 1), 0).xyz);
  if (part.count > 1.0 && is_curved(part.normals, part.pa, part.pb, part.pc, vec2(pixel), same)) {
    same = equal(ivec4(0, 1, 2, 3), ivec4(part.first));
    part.count = 1.0;
    part.p = vec2(pixel) + vec2(kSampleX[part.first], kSampleY[part.first]) / 256.0;
  }
  part.w = corner_weights(part.pa, part.pb, part.pc, part.p);
  // As y points down in the picture, a triangle seen from outside runs clockwise: its area is negative.
  part.behind = edge(part.pb.xy - part.pa.xy, part.pc.xy - part.pa.xy) > 0.0;
  left = bvec4(left.x && !same.x, left.y && !same.y, left.z && !same.z, left.w && !same.w);
  return part;
}

// Shares at a part, between those of its corners.
vec4 interpolated_share(Part part) {
  ivec3 of = part.behind ? part.index + backs : part.index;
  return part.w.x * texelFetch(shares, texel(of.x), 0) + part.w.y * texelFetch(shares, texel(of.y), 0) +
         part.w.z * texelFetch(shares, texel(of.z), 0);
}

// The unit normal at a part on the visible side, turned from the object's frame by `rotation`.
vec3 part_normal(Part part, mat3 rotation) {
  vec3 n = part.normals * part.w;
  n = rotation * (part.behind ? -n : n);
  float size = length(n);
  return size > 0.0 ? n / size : vec3(0.0, 0.0, 1.0);
}
