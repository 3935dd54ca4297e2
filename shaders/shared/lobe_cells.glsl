// The light in a glossy lobe, and what is hidden of it, cell by cell: the same as shading/lobe_cells.cpp. Variant LOBE:
// 1 Blinn's, 2 GGX's. Needs shared/pixel_parts.glsl and shared/glossy.glsl.
uniform usampler2D lobe_masks;  // a bit for each cell that is hidden from an entry; a group has 16
uniform sampler2D lobe_cells;   // direction and flux of each group, then of each cell
uniform int lobe_groups;
uniform float lobe_reach;        // of the cosine with the lobe's middle: groups beyond it count as a whole, or not
uniform float cell_half_exponent, cell_alpha2;         // of the lobe that cells are weighted by,
uniform float lobe_exponent, lobe_least, lobe_alpha2;  // and of the one for single rays; where it ends

uint lobe_mask(int first, int group) {
  int word = (first + group) >> 1;
  return (texelFetch(lobe_masks, texel(word >> 2), 0)[word & 3] >> (16u * uint(group & 1))) & 0xffffu;
}

float bits_in(uint mask) {
  mask -= (mask >> 1u) & 0x5555u;
  mask = (mask & 0x3333u) + ((mask >> 2u) & 0x3333u);
  mask = (mask + (mask >> 4u)) & 0x0f0fu;
  return float((mask + (mask >> 8u)) & 31u);
}

#if LOBE == 2
float ggx_height(float cosine, float half2, float nv, float alpha2, float least_mask) {
  float d = half2 * (alpha2 - 1.0) + 1.0, flatness = 1.0 - alpha2;
  float mask = sqrt(alpha2 + flatness * cosine * cosine) * nv + sqrt(alpha2 + flatness * nv * nv) * cosine;
  return cosine / (d * d * max(mask, least_mask));
}
#endif

// The lobe's height towards the middle of a cell.
float cell_height(vec3 n, vec3 v, float nv, vec3 d) {
  float c = dot(n, d), sum = c + nv, cosine = max(c, 0.0);
  float half2 = sum * sum / max(2.0 + 2.0 * dot(v, d), 1e-6);
#if LOBE == 2
  return ggx_height(cosine, half2, nv, cell_alpha2, 1e-6);
#else
  float u = max(1.0 - half2, 0.0);
  float logarithm = u * (1.0 + u * (0.5 + u * (1.0 / 3.0 + u * (0.25 + u * 0.2))));
  return cosine * exp2(max(-1.44269504 * cell_half_exponent * logarithm, -80.0));
#endif
}

// The same towards a ray.
float ray_height(vec3 n, vec3 v, vec3 d) {
  float cosine = dot(n, d), nv = dot(n, v);
  if (cosine <= 0.0) return 0.0;
  float length2 = max(2.0 + 2.0 * dot(d, v), 1e-9), half_cosine = (cosine + nv) / sqrt(length2);
#if LOBE == 2
  return ggx_height(cosine, half_cosine * half_cosine, max(nv, 1e-3), lobe_alpha2, 1e-9);
#else
  if (half_cosine < lobe_least) return 0.0;
  return cosine * falling_exponential(0.5 * lobe_exponent * squared_angle(min(half_cosine, 1.0)));
#endif
}

// The same towards the middle of a square of this width (radians): the lobe is taken to be wider by about half of it.
float square_height(vec3 n, vec3 v, vec3 d, float width) {
  float middle = dot(n, d), nv = dot(n, v), sum = max(middle + nv, 0.0), length2 = max(2.0 + 2.0 * dot(d, v), 1e-4);
  float cosine = max(middle + 0.5 * width, 0.0), half2 = min(sum * sum / length2, 1.0), variance = width * width / length2;
#if LOBE == 2
  return ggx_height(cosine, half2, max(nv, 1e-3), min(lobe_alpha2 + 2.0 * variance, 1.0), 1e-9);
#else
  float logarithm = squared_angle(max(sqrt(half2), 1e-3));
  return cosine * falling_exponential(0.5 * logarithm / (1.0 / max(lobe_exponent, 1e-3) + variance));
#endif
}

// Lobe times flux, of all cells and of those that are hidden. masks: where those of three corners begin.
vec2 cell_sums(vec3 n, vec3 view, ivec3 masks, vec3 weights) {
  const float kGrazing = 0.02;
  float cosine = dot(n, view);
  if (cosine < kGrazing) view = normalize(view + (kGrazing - cosine) * n);
  float nv = max(dot(n, view), 1e-3);
  vec3 mirrored = 2.0 * nv * n - view;
  vec2 sums = vec2(0.0);
  for (int group = 0; group < lobe_groups; ++group) {
    vec4 middle = texelFetch(lobe_cells, texel(group), 0);
    bool near = dot(middle.xyz, mirrored) > lobe_reach;
#if LOBE == 1
    if (!near) continue;
#endif
    uvec3 hidden = uvec3(lobe_mask(masks.x, group), lobe_mask(masks.y, group), lobe_mask(masks.z, group));
#if LOBE == 2
    if (!near) {
      float weight = cell_height(n, view, nv, middle.xyz) * middle.w;
      vec3 part = vec3(bits_in(hidden.x), bits_in(hidden.y), bits_in(hidden.z)) / 16.0;
      sums += weight * vec2(1.0, dot(weights, part));
      continue;
    }
#endif
    for (int k = 0; k < 16; ++k) {
      vec4 cell = texelFetch(lobe_cells, texel(lobe_groups + 16 * group + k), 0);
      float weight = cell_height(n, view, nv, cell.xyz) * cell.w;
      sums += weight * vec2(1.0, dot(weights, vec3((hidden >> uint(k)) & 1u)));
    }
  }
  return sums;
}

float share_of_lobe(vec2 sums) { return sums.x > 0.0 ? clamp(1.0 - sums.y / sums.x, 0.0, 0.99998) : 1.0; }
