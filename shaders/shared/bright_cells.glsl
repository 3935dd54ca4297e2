// Rays to the brightest cells of the light: the same as shading/bright_cells.cpp. Needs shared/tree.glsl.
uniform sampler2D bright;  // five texels a cell: direction, first ray; light by channel, rays, first rays, flux of a ray;
                           // flux for lobes. Then the rays' directions, and 1 where they are for lobes. All in the object's
                           // frame.
uniform int bright_cells;
uniform float cell_width;  // radians

struct BrightCell {
  vec3 direction;
  mat3 moments;            // columns by channel: the integral of L w over its directions
  int first, count;        // of its rays
  int first_count;         // that are traced before the others
  float flux;              // of each of them
  float for_lobes;         // of all of them but those to near lights
};

BrightCell bright_cell(int i) {
  vec4 a = texelFetch(bright, texel(5 * i), 0), b = texelFetch(bright, texel(5 * i + 1), 0),
       c = texelFetch(bright, texel(5 * i + 2), 0), d = texelFetch(bright, texel(5 * i + 3), 0);
  float for_lobes = texelFetch(bright, texel(5 * i + 4), 0).x;
  return BrightCell(a.xyz, mat3(b.xyz, c.xyz, d.xyz), int(a.w), int(b.w), int(c.w), d.w, for_lobes);
}

vec4 bright_ray(int i) { return texelFetch(bright, texel(5 * bright_cells + i), 0); }

// What a place sees of a cell.
struct SeenCell {
  uint free;   // its rays, a bit for each
  float lost;  // the part of its light that is hidden
};

// starts: of the rays, at the four samples of a pixel; or one where not `several`.
SeenCell look_at(BrightCell cell, vec3 starts[4], bool several) {
  SeenCell seen = SeenCell(0u, 0.0);
  int end = cell.first_count;
  float hidden = 0.0, first = 0.0;  // of all, and of the first round
  // First from two of four starts, which lie across from each other. Where the cell is hidden in part, then all rays; and
  // where there are few, those again from the other two starts.
  for (int r = 0; r < end; ++r) {
    int start = !several                          ? 0
                : r < cell.first_count            ? 3 * (r & 1)
                : cell.count > cell.first_count   ? (r + 1) & 3
                                                  : 1 + (r & 1);
    bool met = meets_mesh(starts[start], bright_ray(cell.first + (r < cell.count ? r : r - cell.count)).xyz);
    hidden += met ? 1.0 : 0.0;
    if (!met && r < cell.count) seen.free |= 1u << uint(r);
    if (r + 1 == cell.first_count) {
      first = hidden;
      if (hidden > 0.0 && hidden < float(end))
        end = cell.count > cell.first_count ? cell.count : several ? 2 * cell.count : end;
    }
  }
  if (first == 0.0) seen.free = 0xffffffffu;
  seen.lost = hidden / float(end);
  return seen;
}

vec3 share_of(vec3 part, vec3 whole) { return mix(vec3(0.0), part / whole, greaterThan(whole, vec3(0.0))); }
