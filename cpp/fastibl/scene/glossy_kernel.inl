// The glossy term of many normals and views, eight at a time: as GlossyShading::reflected. See
// core/wide.h for how it is compiled. Counts are whole blocks.

#include "fastibl/core/wide.inl"
#include "fastibl/core/wide_formulas.inl"
#include "fastibl/scene/level_kernel.inl"

#define float Wide
#define FN FASTIBL_KERNEL_INLINE
#include "shaders/shared/glossy.glsl"
#include "shaders/shared/placed_light.glsl"
#undef FN
#undef float
#include "fastibl/scene/seen_lights_kernel.inl"

// Numbers of the lobe between two columns.
struct WideColumn {
  const float* columns;
  WideInt at;
  Wide f;
  FASTIBL_KERNEL_INLINE Wide operator()(std::size_t offset) const {
    const float* first = columns + offset / sizeof(float);
    const Wide a = gather(first, at), b = gather(first + kColumnFloats, at);
    return multiply_add(f, b - a, a);
  }
};

// Eq. 2: the mirror direction in the map's levels 0 and 1 of k, `coarse` of the second.
FASTIBL_TARGET void mip_block(const float* normals, const float* views, int count,
                              const LevelArrays& k, float coarse, float* out) {
  for (int i = 0; i < 3 * count; i += 3 * kWide) {
    vec3 n, v;
    load_vectors(normals + i, n.x, n.y, n.z);
    load_vectors(views + i, v.x, v.y, v.z);
    const vec3 mirror = 2 * dot(n, v) * n - v;
    const WideFacePoint point = face_point(mirror.x, mirror.y, mirror.z);
    FourFloats sums[kWide] = {};
    add_look_ups(point, k, WideInt{}, repeat(1 - coarse), sums);
    if (coarse > 0) add_look_ups(point, k, WideInt{} + 1, repeat(coarse), sums);
    const vec3 value = transposed(sums);
    store_vectors(out + i, value.x, value.y, value.z);
  }
}

constexpr float kOutside = 2e-14f;  // what light_lobe gives far beyond a lobe, where all is below

// positions: null where all are the map's centre.
FASTIBL_TARGET void chain_block(const float* normals, const float* views, const float* positions,
                                int count, const ChainKernel& k, float* out) {
  using Column = GlossyLobe::Column;
  const GlossyLobe& lobe = *k.lobe;
  const LightArrays& lights = *k.lights;
  const vec3 centre = repeat(k.centre);
  const float by_harmonics = lobe.harmonics, by_taps = 1 - by_harmonics;
  const int taps = by_taps > 0 ? lobe.taps : 0;
  vec3 harmonics[25];
  if (by_harmonics > 0)
    for (int j = 0; j < 25; ++j) harmonics[j] = repeat(k.harmonics + 3 * j);
  for (int i = 0; i < 3 * count; i += 3 * kWide) {
    vec3 n, v, offset{};  // of the place, from the map's centre
    load_vectors(normals + i, n.x, n.y, n.z);
    load_vectors(views + i, v.x, v.y, v.z);
    if (positions) {
      load_vectors(positions + i, offset.x, offset.y, offset.z);
      offset = offset - centre;
    }
    const Wide cosine = dot(n, v), c = clamp(cosine, 0, 1), sine = sqrt(1 - c * c);
    vec3 tangent = v - cosine * n;
    tangent = (1 / max(sqrt(dot(tangent, tangent)), 1e-6f)) * tangent;
    const vec3 mirror = c * n - sine * tangent, down = -sine * n - c * tangent;
    const Wide place = lobe_column(c), first = min(floor(place), GlossyLobe::kColumns - 2);
    const WideColumn column{reinterpret_cast<const float*>(lobe.columns.data()),
                            __builtin_convertvector(first, WideInt) * kColumnFloats, place - first};
    vec3 value{};
    if (by_harmonics > 0) {
      constexpr std::size_t kTurn = offsetof(Column, direction), kBands = offsetof(Column, bands);
      const vec3 turned = column(kTurn) * mirror + column(kTurn + sizeof(float)) * down;
      const vec4 bands{column(kBands), column(kBands + sizeof(float)),
                       column(kBands + 2 * sizeof(float)), column(kBands + 3 * sizeof(float))};
      value = repeat(by_harmonics) *
              harmonics_radiance(harmonics, (1 / sqrt(dot(turned, turned))) * turned, bands);
    }
    PlacedLight seen[kMaxLights];
    see_lights(lights, offset, seen);
    FourFloats looked[kWide] = {};
    vec3 directions[GlossyLobe::kMaxTaps];
    Wide weights[GlossyLobe::kMaxTaps], levels[GlossyLobe::kMaxTaps], spreads[GlossyLobe::kMaxTaps];
    Wide highest = {};
    for (int t = 0; t < taps; ++t) {
      const std::size_t at = offsetof(Column, taps) + std::size_t(t) * sizeof(glm::vec4);
      const vec3 direction = column(at) * mirror + column(at + sizeof(float)) * down;
      const Wide weight = column(at + 3 * sizeof(float)), own = by_taps * weight;
      spreads[t] = column(offsetof(Column, spreads) + std::size_t(t) * sizeof(float));
      vec3 to = direction;
      Wide level = clamp(column(at + 2 * sizeof(float)), 0, GlossyChain::kLevelCount - 1);
      if (positions && lights.any_near) move_look_up(lights, seen, spreads[t], to, level);
      const Wide fine = min(floor(level), GlossyChain::kLevelCount - 2), coarse = level - fine;
      const WideInt index = __builtin_convertvector(fine, WideInt);
      const WideFacePoint point = face_point(to.x, to.y, to.z);
      add_look_ups(point, k.levels, index, own * (1 - coarse), looked);
      add_look_ups(point, k.levels, index + 1, own * coarse, looked);
      directions[t] = direction, weights[t] = weight, levels[t] = level;
      highest = max(highest, level);
    }
    if (taps > 0) value += transposed(looked);

    // Below the finest light's level look-ups hold all light.
    if (lights.count > 0 && (by_harmonics > 0 || set_bits(highest > lights.finest - 1))) {
      vec3 sum{};
      for (int l = 0; l < lights.count; ++l) {
        const PlacedLight& light = seen[l];
        const Wide facing = soft_positive(dot(n, light.direction), 1.5f * sqrt(light.variance));
        if (!set_bits(facing > 0)) continue;
        const Wide through =
            light_lobe(repeat(lobe.exponent), light.variance, n, v, light.direction);
        if (!set_bits(through > kOutside)) continue;
        Wide near = {}, left = {};
        for (int t = 0; t < taps; ++t) {
          const Wide part = weights[t] * seen_by_tap(directions[t], light.direction,
                                                     spreads[t] + light.variance);
          near += part;
          left += part * light_share(levels[t], repeat(lights.level[l]));
        }
        const Wide share =
            light.gain * (by_harmonics + by_taps * left / max(near, 1e-30f)) * through;
        sum += vec3{share * lights.red[l], share * lights.green[l], share * lights.blue[l]};
      }
      value += exp2(-column(offsetof(Column, log_integral))) * sum;
    }
    store_vectors(out + i, value.x, value.y, value.z);
  }
}
