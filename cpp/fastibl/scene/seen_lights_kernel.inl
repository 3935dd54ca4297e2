// The lights of a glossy chain as seen from eight places: as seen_lights.h. Included after
// placed_light.glsl was, eight places wide.

// offset: of the places, from the map's centre.
FASTIBL_KERNEL_INLINE void see_lights(const LightArrays& lights, vec3 offset, PlacedLight* seen) {
  for (int i = 0; i < lights.count; ++i) {
    const vec3 towards{repeat(lights.x[i]), repeat(lights.y[i]), repeat(lights.z[i])};
    seen[i] = {towards, repeat(lights.variance[i]), repeat(1)};
    if (lights.inverse_distance[i] > 0)
      seen[i] = placed_light(towards, repeat(lights.inverse_distance[i]), seen[i].variance, offset);
  }
}

// Moves a look-up in a direction so that it shows near lights where they are.
FASTIBL_KERNEL_INLINE void move_look_up(const LightArrays& lights, const PlacedLight* seen,
                                        Wide spread, vec3& direction, Wide& level) {
  MovedLookUp moved{};
  for (int i = 0; i < lights.count; ++i) {
    if (!(lights.inverse_distance[i] > 0)) continue;
    const Wide held = 1 - light_share(level, repeat(lights.level[i]));
    if (!set_bits(held > 0)) continue;
    const vec3 towards{repeat(lights.x[i]), repeat(lights.y[i]), repeat(lights.z[i])};
    // Most look-ups are near none, and are not moved: see around_light().
    const Wide off = min(1 - dot(direction, seen[i].direction), 1 - dot(direction, towards));
    const Wide variance = max(seen[i].variance, lights.variance[i]);
    if (!set_bits(off < 18 * (variance + spread))) continue;
    moved = moved_for(moved, direction, direction, level, spread, held, seen[i], towards,
                      repeat(lights.variance[i]), repeat(lights.level[i]));
  }
  direction = moved_direction(moved, direction);
  level = clamp(moved_level(moved, level), 0, GlossyChain::kLevelCount - 1);
}
