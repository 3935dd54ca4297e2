// Light in round GGX lobes, eight at a time: as GgxShading's operator() has it. See core/wide.h for
// how it is compiled.

#include "fastibl/core/wide.inl"
#include "fastibl/core/wide_formulas.inl"
#include "fastibl/scene/level_kernel.inl"

#define float Wide
#define FN FASTIBL_KERNEL_INLINE
#include "shaders/shared/ggx_light.glsl"
#include "shaders/shared/glossy.glsl"
#include "shaders/shared/placed_light.glsl"
#undef FN
#undef float
#include "fastibl/scene/seen_lights_kernel.inl"

FASTIBL_KERNEL_INLINE Wide load(const float* p) {
  Wide a;
  std::memcpy(&a, p, sizeof a);
  return a;
}

// atan(y / x) of numbers ≥ 0, not both 0: Abramowitz and Stegun 4.4.49, within 2e-8.
FASTIBL_KERNEL_INLINE Wide angle_of(Wide y, Wide x) {
  const WideInt steep = y > x;
  const Wide r = min(x, y) / max(max(x, y), 1e-30f), r2 = r * r;
  Wide sum = repeat(0.0028662257f);
  for (const float c : {-0.0161657367f, 0.0429096138f, -0.0752896400f, 0.1065626393f,
                        -0.1420889944f, 0.1999355085f, -0.3333314528f, 1.0f})
    sum = multiply_add(sum, r2, repeat(c));
  return steep ? 1.57079633f - r * sum : r * sum;
}

// Taps of eight lobes.
struct EightTaps {
  Wide across[kGgxTaps], up[kGgxTaps], width[kGgxTaps], weight[kGgxTaps];
  Wide albedo;
};
// As IsotropicTaps::at, of a view's parts along the surface and along the normal.
FASTIBL_KERNEL_INLINE void read_taps(const IsotropicTaps::Node* nodes, Wide flat, Wide up,
                                     Wide roughness, EightTaps& taps) {
  using Table = IsotropicTaps;
  constexpr float kSpan = 1 - Table::kLeastRoughness;
  const Wide left = clamp(angle_of(max(up, 0), flat) * 0.63661977f, 0, 1);
  const Wide x = clamp((1 - sqrt(left)) * (Table::kAngles - 1), 0, Table::kAngles - 1);
  const Wide y =
      clamp((roughness - Table::kLeastRoughness) / kSpan, 0, 1) * (Table::kRoughnesses - 1);
  const Wide column = min(floor(x), Table::kAngles - 2),
             row = min(floor(y), Table::kRoughnesses - 2);
  const WideInt first = __builtin_convertvector(row, WideInt) * Table::kAngles +
                        __builtin_convertvector(column, WideInt);
  const Wide fx = x - column, fy = y - row;
  const Wide w[4] = {(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy};
  for (int l = 0; l < kWide; ++l) {
    const Table::Node *a = nodes + first[l], *b = a + Table::kAngles;
    const float w0 = w[0][l], w1 = w[1][l], w2 = w[2][l], w3 = w[3][l];
    taps.across[l] =
        (Wide)(w0 * a[0].across + w1 * a[1].across + w2 * b[0].across + w3 * b[1].across);
    taps.up[l] = (Wide)(w0 * a[0].up + w1 * a[1].up + w2 * b[0].up + w3 * b[1].up);
    taps.width[l] = (Wide)(w0 * a[0].width + w1 * a[1].width + w2 * b[0].width + w3 * b[1].width);
    taps.weight[l] =
        (Wide)(w0 * a[0].weight + w1 * a[1].weight + w2 * b[0].weight + w3 * b[1].weight);
    taps.albedo[l] = w0 * a[0].albedo + w1 * a[1].albedo + w2 * b[0].albedo + w3 * b[1].albedo;
  }
  transpose(taps.across), transpose(taps.up), transpose(taps.width), transpose(taps.weight);
}

// As GlossyChain::level_of.
FASTIBL_KERNEL_INLINE Wide level_of(Wide width, const GgxKernel& k) {
  constexpr float kFinest = GlossyChain::kFinestWidth;
  const Wide above = 1 + log2(max(width, kFinest) * (1 / kFinest));
  const Wide below = log2(max(width, k.own_width) * (1 / k.own_width)) * k.below_scale;
  return clamp(width >= kFinest ? above : below, 0, GlossyChain::kLevelCount - 1);
}

// Of eight places. positions: null where all are the map's centre. out: rows of as many values, in
// the order of a GgxLight's numbers.
FASTIBL_TARGET void ggx_block(const float* normals, const float* views, const float* alphas,
                              const float* positions, const GgxKernel& k, float* out) {
  const LightArrays& lights = *k.lights;
  vec3 n, v, offset{};  // of the place, from the map's centre
  load_vectors(normals, n.x, n.y, n.z);
  load_vectors(views, v.x, v.y, v.z);
  if (positions) {
    load_vectors(positions, offset.x, offset.y, offset.z);
    offset = offset - repeat(k.centre);
  }
  const Wide alpha = clamp(load(alphas), kSmallestAlpha, 1);
  // The surface's frame, with the tangent below the view; any where that is along the normal.
  const Wide cosine = dot(n, v);
  const vec3 side = v - cosine * n;
  const Wide flat = sqrt(dot(side, side)), none = step(flat, 1e-6f);
  const vec3 tangent = normalize((1 - none) * side + any_across(n, none)),
             bitangent = cross(n, tangent);
  const Wide up = max(cosine, 1e-3f), size = 1 / sqrt(flat * flat + up * up);
  const vec3 view{size * flat, Wide{}, size * up};

  PlacedLight seen[kMaxLights];
  see_lights(lights, offset, seen);
  EightTaps taps;
  read_taps(k.nodes, flat, cosine, sqrt(alpha), taps);
  FourFloats front[kWide] = {}, edge[kWide] = {};
  Wide front_weight = {}, edge_weight = {}, highest = {};
  vec3 directions[kGgxTaps];  // in the surface's frame
  Wide fines[kGgxTaps], coarses[kGgxTaps], spreads[kGgxTaps];
  for (int t = 0; t < kGgxTaps; ++t) {
    const Wide across = taps.across[t], along = taps.up[t];
    const Wide length = 1 / sqrt(across * across + along * along);
    const vec3 local{-length * across, Wide{}, length * along};
    const vec3 direction = local.x * tangent + local.z * n;
    const Wide width = taps.width[t], weight = taps.weight[t];
    spreads[t] = width * width;
    vec3 to = direction;
    Wide level = level_of(width, k);
    if (positions && lights.any_near) move_look_up(lights, seen, spreads[t], to, level);
    const Wide e = weight * ggx_edge(local, view), f = weight - e;
    const Wide fine = min(floor(level), GlossyChain::kLevelCount - 2), coarse = level - fine;
    const WideInt index = __builtin_convertvector(fine, WideInt);
    const WideFacePoint point = face_point(to.x, to.y, to.z);
    FourFloats looked[kWide] = {};
    add_look_ups(point, k.levels, index, 1 - coarse, looked);
    add_look_ups(point, k.levels, index + 1, coarse, looked);
    for (int l = 0; l < kWide; ++l) front[l] += f[l] * looked[l], edge[l] += e[l] * looked[l];
    front_weight += f, edge_weight += e;
    directions[t] = local, fines[t] = fine, coarses[t] = coarse;
    highest = max(highest, level);
  }

  // Below the finest light's level look-ups hold all light.
  vec3 front_lights{}, edge_lights{};
  if (lights.count > 0 && set_bits(highest > lights.finest - 1)) {
    const vec2 round{alpha, alpha};
    const Wide view_size = ggx_size(view, round);
    for (int j = 0; j < lights.count; ++j) {
      const PlacedLight& light = seen[j];
      const vec3 l{dot(light.direction, tangent), dot(light.direction, bitangent),
                   dot(light.direction, n)};
      Wide near = {}, left = {};
      for (int t = 0; t < kGgxTaps; ++t) {
        const Wide part =
            taps.weight[t] * seen_by_tap(directions[t], l, spreads[t] + light.variance);
        near += part;
        left += part * light_share_between(fines[t], coarses[t], repeat(lights.level[j]));
      }
      const Wide value = left / max(near, 1e-30f) * light.gain *
                         ggx_light(view, round, view_size, l, light.variance);
      const Wide e = value * ggx_edge(l, view), f = value - e;
      front_lights += vec3{f * lights.red[j], f * lights.green[j], f * lights.blue[j]};
      edge_lights += vec3{e * lights.red[j], e * lights.green[j], e * lights.blue[j]};
    }
  }
  const vec3 in_front = (1 / front_weight) * transposed(front),
             at_edge = (1 / edge_weight) * transposed(edge);
  const Wide rows[kGgxRows] = {in_front.x,
                               in_front.y,
                               in_front.z,
                               at_edge.x,
                               at_edge.y,
                               at_edge.z,
                               edge_weight / (front_weight + edge_weight),
                               front_lights.x,
                               front_lights.y,
                               front_lights.z,
                               edge_lights.x,
                               edge_lights.y,
                               edge_lights.z,
                               max(taps.albedo, 1e-4f)};
  std::memcpy(out, rows, sizeof rows);
}
