// Near lights as they are seen from places beside the map's centre. A light at centre + direction / rho is seen along
// direction - rho (place - centre); the length of that is the light's distance divided by its distance from the centre.
// rho = 0 is a distant light.

// A vector towards the light; its length is the light's distance divided by that from the centre.
FN vec3 near_arrow(vec3 direction, float rho, vec3 offset) { return direction - rho * offset; }

// How far along a ray d (unit) from a place the unit sphere is crossed, first and second; below 0: behind, or not at all.
FN vec2 sphere_crossings(vec3 d, vec3 place) {
  float along = dot(place, d), inside = along * along - dot(place, place) + 1.0f;
  float middle = inside < 0.0f ? -1.0f : -along, half_chord = sqrt(max(inside, 0.0f));
  return vec2(middle - half_chord, middle + half_chord);
}

// A light of the glossy chain seen from such a place. Its radiance summed over its solid angle grows by `gain`, and so
// does its variance (along each axis, radians squared), but to no more than that of a light all around.
struct PlacedLight {
  vec3 direction;
  float variance;
  float gain;
};
FN PlacedLight placed_light(vec3 direction, float rho, float variance, vec3 offset) {
  PlacedLight light;
  vec3 arrow = near_arrow(direction, rho, offset);
  light.gain = min(1.0f / max(dot(arrow, arrow), 1e-12f), max(1.0f / variance, 1.0f));
  light.direction = arrow * (1.0f / sqrt(max(dot(arrow, arrow), 1e-12f)));
  light.variance = variance * light.gain;
  return light;
}

// How a look-up of the glossy chain, which shows lights where the map has them, is moved to show near ones where they are.
// Around such a light, look-ups are those around it in the map; where the map has it and the place does not see it, they
// are so coarse that none of their levels holds it. A lamp may be several lights, which then move a look-up together.
struct MovedLookUp {
  vec3 direction;  // to be added, as is the level; sums over lights
  float level;
  float shown;     // how many lights the look-up is next to
  float hidden;    // levels to be added where it is next to none
};
// 1 within three standard deviations of a light, 0 beyond twice of that. off: 1 − the cosine of the angle.
FN float around_light(float off, float variance) {
  float x = clamp((4.0f - off / (4.5f * variance)) * (1.0f / 3.0f), 0.0f, 1.0f);
  return x * x * (3.0f - 2.0f * x);
}
// Adds a light. d: the look-up as the place sees it, unit; looked: what the map has in that direction; towards: the light
// as the map has it; spread: of the look-up, radians squared; held: the part of the light that look-ups of its level
// hold, without which nothing is moved.
FN MovedLookUp moved_for(MovedLookUp moved, vec3 d, vec3 looked, float level, float spread, float held,
                         PlacedLight seen, vec3 towards, float variance, float light_level) {
  float some = clamp(3.0f * held, 0.0f, 1.0f), size = 1.0f / sqrt(max(seen.gain, 1e-6f));
  float shown = some * around_light(1.0f - dot(d, seen.direction), seen.variance + spread);
  float there = some * around_light(1.0f - dot(looked, towards), variance + spread);
  moved.direction = moved.direction + shown * (towards + size * (d - seen.direction) - looked);
  moved.level = moved.level + shown * min(level, 1.0f) * log2(size);
  moved.shown = moved.shown + shown;
  moved.hidden = max(moved.hidden, max(there - shown, 0.0f) * max(light_level + 2.0f - level, 0.0f));
  return moved;
}
FN vec3 moved_direction(MovedLookUp moved, vec3 looked) {
  return looked + (1.0f / max(moved.shown, 1.0f)) * moved.direction;
}
FN float moved_level(MovedLookUp moved, float level) {
  return level + moved.level / max(moved.shown, 1.0f) + max(1.0f - moved.shown, 0.0f) * moved.hidden;
}
