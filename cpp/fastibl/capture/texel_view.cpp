#include "fastibl/capture/texel_view.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/simd.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/shared_formulas.h"

namespace fastibl {
namespace {

constexpr float kSmallestDepth = 1e-9f;  // as in Lens
constexpr double kBehind = -0.9;  // cosine: the light is seen from behind, however it is turned
constexpr double kMargin = 0.02;  // of the picture's bounds, for a border that is curved

struct FaceAxes {
  glm::vec3 centre, s, t;  // direction: centre + (2 s − 1) s + (2 t − 1) t
};
FaceAxes face_axes(int face) {
  const glm::vec3 centre = face_direction(face, 0.5f, 0.5f);
  return {centre, face_direction(face, 1, 0.5f) - centre, face_direction(face, 0.5f, 1) - centre};
}

// A projection along the axes of one face.
struct FaceProjection {
  float origin[3], along_s[3], along_t[3];  // in the camera frame
  float world[3], world_s[3], world_t[3];   // marker frame
  float walls[3], walls_s[3], walls_t[3];   // along the walls
};

FaceProjection on_face(const TexelView::Projection& p, int face) {
  const FaceAxes axes = face_axes(face);
  const FaceAxes walls{shared::along_walls(axes.centre, p.walls_axis),
                       shared::along_walls(axes.s, p.walls_axis),
                       shared::along_walls(axes.t, p.walls_axis)};
  FaceProjection out;
  for (int r = 0; r < 3; ++r) {
    const glm::vec3 row(p.turn[0][r], p.turn[1][r], p.turn[2][r]);
    out.origin[r] = glm::dot(row, axes.centre);
    out.along_s[r] = glm::dot(row, axes.s), out.along_t[r] = glm::dot(row, axes.t);
    out.world[r] = axes.centre[r], out.world_s[r] = axes.s[r], out.world_t[r] = axes.t[r];
    out.walls[r] = walls.centre[r], out.walls_s[r] = walls.s[r], out.walls_t[r] = walls.t[r];
  }
  return out;
}

// Camera directions of a group's texels above or below the horizon, and pixels at depth 1.
FASTIBL_CLONES void turn_texels(const TexelView::Projection& p, const FaceProjection& f,
                                const TexelGroup& g, float* __restrict tx, float* __restrict ty,
                                float* __restrict tz, float* __restrict pixels,
                                int* __restrict seen) {
  const int n = lanes_of(g.count);
  const float first_s = g.first_s, first_t = g.first_t, step = g.step;
  for (int i = 0; i < n; ++i) {
    const float a = first_s + step * g.columns[i], b = first_t + step * g.rows[i];
    tx[i] = f.origin[0] + a * f.along_s[0] + b * f.along_t[0];
    ty[i] = f.origin[1] + a * f.along_s[1] + b * f.along_t[1];
    tz[i] = f.origin[2] + a * f.along_s[2] + b * f.along_t[2];
    pixels[i] = p.pixels;
    const float z = f.world[2] + a * f.world_s[2] + b * f.world_t[2];
    seen[i] = (i < g.count) & ((z >= 0) == p.above);
  }
  const bool box = g.depth.box;
  if (p.shifted && (box || g.depth.inverse_distance > 0))
    for (int i = 0; i < n; ++i) {
      const float a = first_s + step * g.columns[i], b = first_t + step * g.rows[i];
      const float square = 1 + a * a + b * b;
      float near = g.depth.inverse_distance * std::sqrt(square);  // |d| / distance
      if (box) {
        near = 0;
        for (int axis = 0; axis < 3; ++axis) {
          const float d = f.walls[axis] + a * f.walls_s[axis] + b * f.walls_t[axis];
          const float upper = d * p.walls[0][axis], lower = d * p.walls[1][axis];
          near = upper > near ? upper : near;
          near = lower > near ? lower : near;
        }
      }
      const float x = tx[i], y = ty[i], z = tz[i];
      tx[i] = x + near * p.shift[0], ty[i] = y + near * p.shift[1], tz[i] = z + near * p.shift[2];
      // As for a surface that faces the centre.
      pixels[i] *= std::fabs(x * tx[i] + y * ty[i] + z * tz[i]) / square;
    }
  if (p.masked)
    for (int i = 0; i < n; ++i) {
      const float a = first_s + step * g.columns[i], b = first_t + step * g.rows[i];
      const float z = f.world[2] + a * f.world_s[2] + b * f.world_t[2];
      const float reach = p.plane_distance / -z;
      const float x = p.centre_x + reach * (f.world[0] + a * f.world_s[0] + b * f.world_t[0]);
      const float y = p.centre_y + reach * (f.world[1] + a * f.world_s[1] + b * f.world_t[1]);
      seen[i] &= !(int(std::fabs(x) < p.masked_x) & int(std::fabs(y) < p.masked_y));
    }
}

// Projects camera directions to pixels.
FASTIBL_CLONES void project_texels(const TexelView::Projection& p, const float* __restrict tx,
                                   const float* __restrict ty, const float* __restrict tz,
                                   int lanes, float* __restrict px, float* __restrict py,
                                   float* __restrict pixels, int* __restrict seen) {
  const int n = lanes & ~15;
  if (p.lens)
    for (int i = 0; i < n; ++i) {
      const float iz = 1 / tz[i], x = tx[i] * iz, y = ty[i] * iz, q = x * x + y * y;
      // As in shared/lens.glsl.
      const float g = (1 + q * (p.k[0] + q * (p.k[1] + q * p.k[4]))) /
                      (1 + q * (p.k[5] + q * (p.k[6] + q * p.k[7])));
      const float u = x * g + 2 * p.k[2] * x * y + p.k[3] * (q + 2 * x * x);
      const float v = y * g + p.k[2] * (q + 2 * y * y) + 2 * p.k[3] * x * y;
      const float at_x = p.fx * u + p.cx, at_y = p.fy * v + p.cy;
      px[i] = at_x, py[i] = at_y;
      pixels[i] *= std::fabs(iz * iz * iz);
      seen[i] &= (tz[i] > kSmallestDepth) & (q < p.limit2) & (at_x >= 0) & (at_y >= 0) &
                 (at_x < p.width) & (at_y < p.height);
    }
  else
    for (int i = 0; i < n; ++i) {
      const float iz = 1 / tz[i];
      const float at_x = p.fx * (tx[i] * iz) + p.cx, at_y = p.fy * (ty[i] * iz) + p.cy;
      px[i] = at_x, py[i] = at_y;
      pixels[i] *= std::fabs(iz * iz * iz);
      seen[i] &= (tz[i] > kSmallestDepth) & (at_x >= 0) & (at_y >= 0) & (at_x < p.width) &
                 (at_y < p.height);
    }
}

FASTIBL_CLONES int count_seen(const int* seen, int lanes) {
  const int n = lanes & ~15;
  int count = 0;
  for (int i = 0; i < n; ++i) count += seen[i];
  return count;
}

constexpr float kLongest = 1.74f;  // length of a direction to a face's corner

// Adds what a side of the horizon shows. A tile is the cone of its corners, so it lies beyond a
// side of the picture if all of them do. With near surroundings, the surface between the corners
// bulges a little: a sphere by the tile's own bulge, a box by no more than its depth differs from
// corner to corner. near: by corner, see Surroundings; null where all is far away.
template <typename V>
FASTIBL_INLINE void find_tiles_by(const TexelView::Projection& p, const PictureBounds& bounds,
                                  const TileOutlines::Corner (&corners)[4],
                                  const float* const* near, const float* bulges,
                                  const float* on_side, int count, float* most_pixels) {
  const PictureBounds side = bounds;
  const float slope_x = 1 + std::max(std::fabs(side.left), std::fabs(side.right));
  const float slope_y = 1 + std::max(std::fabs(side.top), std::fabs(side.bottom));
  const float t00 = p.turn[0][0], t01 = p.turn[0][1], t02 = p.turn[0][2];
  const float t10 = p.turn[1][0], t11 = p.turn[1][1], t12 = p.turn[1][2];
  const float t20 = p.turn[2][0], t21 = p.turn[2][1], t22 = p.turn[2][2];
  const float s0 = p.shift[0], s1 = p.shift[1], s2 = p.shift[2], texel = p.pixels;
  const float offset = std::sqrt(s0 * s0 + s1 * s1 + s2 * s2);
  const auto greater = [](const V& u, const V& v) FASTIBL_INLINED -> V { return u > v ? u : v; };
  const auto less = [](const V& u, const V& v) FASTIBL_INLINED -> V { return u < v ? u : v; };
  const V none = {};
  for (int i = 0; i < count; i += kFloatsIn<V>) {
    float any = 0;
    for (int k = i; k < i + kFloatsIn<V>; ++k) any += on_side[k];
    if (any == 0) continue;
    const auto at = [i](const auto& values) FASTIBL_INLINED -> V {
      return floats_at<V>(&values[std::size_t(i)]);
    };
    V left = none - 1e30f, right = left, top = left, bottom = left, front = left, most = none;
    V nearest = none, farthest = none + 1e30f;
    for (int k = 0; k < 4; ++k) {
      const TileOutlines::Corner& c = corners[k];
      const V x = at(c.x), y = at(c.y), z = at(c.z);
      const V w = near ? at(near[k]) : none;
      const V tx = t00 * x + t10 * y + t20 * z + w * s0;
      const V ty = t01 * x + t11 * y + t21 * z + w * s1;
      const V tz = t02 * x + t12 * y + t22 * z + w * s2;
      nearest = greater(nearest, w), farthest = less(farthest, w);
      left = greater(left, tx - side.left * tz), right = greater(right, side.right * tz - tx);
      top = greater(top, ty - side.top * tz), bottom = greater(bottom, side.bottom * tz - ty);
      front = greater(front, tz);
      // At less depth a texel covers more than any level of the picture averages.
      const V ratio = 1.0f / greater(tz, none + 0.02f);
      most = greater(most, texel * ratio * ratio * ratio);
    }
    const V bulge = near ? (kLongest * at(bulges) * nearest + (nearest - farthest)) * offset : none;
    const V x = bulge * slope_x, y = bulge * slope_y;
    most = left + x >= 0.0f ? most : none, most = right + x >= 0.0f ? most : none;
    most = top + y >= 0.0f ? most : none, most = bottom + y >= 0.0f ? most : none;
    most = front + bulge >= 0.0f ? most : none;
    most *= at(on_side);
    put_floats(greater(floats_at<V>(most_pixels + i), most), most_pixels + i);
  }
}
FASTIBL_BY_WIDTH(void find_tiles_of(const TexelView::Projection& p, const PictureBounds& bounds,
                                    const TileOutlines::Corner (&corners)[4],
                                    const float* const* near, const float* bulges,
                                    const float* on_side, int count, float* most_pixels),
                 find_tiles_by<V>(p, bounds, corners, near, bulges, on_side, count, most_pixels))

void set_turn(TexelView::Projection& to, const glm::dmat3& turn) {
  for (int c = 0; c < 3; ++c)
    for (int r = 0; r < 3; ++r) to.turn[c][r] = float(turn[c][r]);
}

}  // namespace

glm::dmat3 rotation_between(const glm::dvec3& from, const glm::dvec3& to) {
  const glm::dvec3 sum = from + to;
  return glm::dmat3(1.0) - glm::outerProduct(sum, sum) / (1 + glm::dot(from, to)) +
         2.0 * glm::outerProduct(to, from);
}

TileOutlines::TileOutlines(TileGrid tiles) : grid(tiles) {
  for (int tile = 0; tile < grid.count(); ++tile) {
    const FaceRect r = tile_rect(grid, tile);
    const auto corner = [&](int u, int v) {
      return face_direction(r.face, float(u) / float(grid.size), float(v) / float(grid.size));
    };
    const glm::vec3 ends[4] = {corner(r.x0, r.y0), corner(r.x1, r.y0), corner(r.x0, r.y1),
                               corner(r.x1, r.y1)};
    const glm::vec3 middle = glm::normalize(glm::normalize(ends[0]) + glm::normalize(ends[3]));
    float smallest = 1, lowest = 1, highest = -1;
    for (int c = 0; c < 4; ++c) {
      const glm::vec3& d = ends[c];
      corners[c].x.push_back(d.x), corners[c].y.push_back(d.y), corners[c].z.push_back(d.z);
      corners[c].scale.push_back(1 / glm::length(d));
      smallest = std::min(smallest, glm::dot(glm::normalize(d), middle));
      lowest = std::min(lowest, d.z), highest = std::max(highest, d.z);
    }
    bulge.push_back(1 - smallest);
    above.push_back(highest > 0 ? 1.0f : 0.0f), below.push_back(lowest < 0 ? 1.0f : 0.0f);
  }
  const std::size_t padded = std::size_t(lanes_of(grid.count()));
  for (Corner& c : corners)
    for (auto* values : {&c.x, &c.y, &c.z, &c.scale}) values->resize(padded, 1.0f);
  bulge.resize(padded, 0.0f), above.resize(padded, 0.0f), below.resize(padded, 0.0f);
}

glm::dvec3 TileOutlines::middle(int tile) const {
  const std::size_t i = std::size_t(tile);
  glm::dvec3 sum(0);
  for (const Corner& c : corners) sum += double(c.scale[i]) * glm::dvec3(c.x[i], c.y[i], c.z[i]);
  return glm::normalize(sum);
}

double TileOutlines::reach(int tile) const {
  return std::acos(std::max(-1.0, 1.0 - double(bulge[std::size_t(tile)])));
}

PictureBounds picture_bounds(const Camera& camera, const Lens& lens) {
  glm::dvec2 least(1e30), most(-1e30);  // of the picture's border without the lens
  constexpr int kSteps = 8;
  for (int i = 0; i <= kSteps; ++i)
    for (const glm::dvec2 part :
         {glm::dvec2(i, 0), glm::dvec2(i, kSteps), glm::dvec2(0, i), glm::dvec2(kSteps, i)}) {
      const auto ray =
          lens.unproject(part / double(kSteps) * glm::dvec2(camera.width, camera.height));
      // Where the lens does not reach, its circle ends the picture.
      const double limit = std::min(1e6, std::sqrt(lens.limit2()));
      least = glm::min(least, ray ? glm::dvec2(*ray) : glm::dvec2(-limit));
      most = glm::max(most, ray ? glm::dvec2(*ray) : glm::dvec2(limit));
    }
  const glm::dvec2 margin = kMargin * (most - least) + 1e-6;
  return {float(least.x - margin.x), float(most.x + margin.x), float(least.y - margin.y),
          float(most.y + margin.y)};
}

TexelView::TexelView(const Camera& camera, const Lens& lens, const PictureBounds& bounds,
                     const Pose& camera_from_marker, const Viewpoint& viewpoint, int size)
    : surroundings_(viewpoint.surroundings), bounds_(bounds) {
  const glm::dvec3 centre = camera_from_marker * viewpoint.centre;
  const double height = camera_from_marker.inverse().translation.z;
  // Below the horizon a direction d meets the plane at c − (c_z / d_z) d. In the camera's frame
  // this is a multiple of (R − c e_zᵀ / c_z) d, which is linear in d, as for light from far away.
  // The plane hides what is under it, and its underside is not the table.
  sees_plane_ = height > 0;
  turn_ = camera_from_marker.rotation, centre_ = centre;
  const glm::dmat3 turn_above = turn_;
  glm::dmat3 turn_below = turn_above;
  turn_below[2] -= centre / viewpoint.centre.z;

  Projection p{};
  p.fx = float(camera.fx), p.fy = float(camera.fy);
  p.cx = float(camera.cx), p.cy = float(camera.cy);
  for (std::size_t i = 0; i < camera.distortion.size() && i < 8; ++i)
    p.k[i] = float(camera.distortion[i]);
  p.lens = !lens.trivial();
  p.limit2 = float(lens.limit2());
  p.width = float(camera.width), p.height = float(camera.height);
  // A texel of solid angle 4/n² / |d|³ at the depth z of its direction d covers f_x f_y 4/n² / z³.
  const double texel = 4.0 / size / size * camera.fx * camera.fy;
  above_ = below_ = p;
  set_turn(above_, turn_above);
  above_.above = true;
  above_.shifted = surroundings_.are_near();
  for (int r = 0; r < 3; ++r) {
    above_.shift[r] = float(centre[r]);
    for (int k = 0; k < 2; ++k) above_.walls[k][r] = surroundings_.walls()[k][r];
  }
  above_.walls_axis = surroundings_.surface().walls_axis();
  above_.pixels = float(texel);
  set_turn(below_, turn_below);
  below_.pixels = float(texel * std::max(0.0, height) / viewpoint.centre.z);
  below_.masked = viewpoint.masked.x > 0;
  below_.masked_x = float(viewpoint.masked.x), below_.masked_y = float(viewpoint.masked.y);
  below_.plane_distance = float(viewpoint.centre.z);
  below_.centre_x = float(viewpoint.centre.x), below_.centre_y = float(viewpoint.centre.y);
}

// The projection above the horizon for what is as far as a light: it lies about the light, on a
// sphere around the centre that is turned to face the camera. So a lamp is equally wide from
// everywhere. A sphere that faced the centre alone would be seen aslant, and the lamp drawn out on
// it.
TexelView::Projection TexelView::facing(const glm::vec3& light) const {
  const glm::dvec3 eye = -(glm::transpose(turn_) * centre_), at(light);
  const glm::dvec3 from = glm::normalize(at), to = at - eye;
  const double distance = glm::length(to);
  Projection p = above_;
  if (!(distance > 0) || !(glm::dot(from, to) > kBehind * distance)) return p;
  const glm::dmat3 turn = turn_ * rotation_between(from, to / distance);
  const glm::dvec3 shift = centre_ + turn_ * at - turn * at;
  set_turn(p, turn);
  for (int r = 0; r < 3; ++r) p.shift[r] = float(shift[r]);
  return p;
}

void TexelView::find_tiles(const TileOutlines& outlines, std::vector<float>& most_pixels) const {
  const int count = int(outlines.bulge.size());
  most_pixels.assign(outlines.bulge.size(), 0.0f);
  const float* near[4];
  for (int c = 0; c < 4; ++c) near[c] = surroundings_.corner(c).data();
  find_tiles_of(above_, bounds_, outlines.corners, above_.shifted ? near : nullptr,
                outlines.bulge.data(), outlines.above.data(), count, most_pixels.data());
  for (const Surroundings::LitTiles& lit : surroundings_.lit_tiles())
    find_tiles_of(facing(lit.light), bounds_, outlines.corners, near, outlines.bulge.data(),
                  lit.tiles.data(), count, most_pixels.data());
  if (sees_plane_)
    find_tiles_of(below_, bounds_, outlines.corners, nullptr, outlines.bulge.data(),
                  outlines.below.data(), count, most_pixels.data());
}

bool TexelView::see(const TexelGroup& group, bool above, Sightings& s) const {
  if (!above && !sees_plane_) return false;
  alignas(64) float tx[kTexelLanes], ty[kTexelLanes], tz[kTexelLanes];
  const int lanes = lanes_of(group.count);
  Projection lit;
  const bool at_light = above && group.depth.light != glm::vec3(0);
  if (at_light) lit = facing(group.depth.light);
  const Projection& p = at_light ? lit : above ? above_ : below_;
  turn_texels(p, on_face(p, group.face), group, tx, ty, tz, s.pixels, s.seen);
  project_texels(p, tx, ty, tz, lanes, s.x, s.y, s.pixels, s.seen);
  return count_seen(s.seen, lanes) > 0;
}

glm::vec2 TexelView::pixel(const TexelGroup& group, bool above) const {
  Sightings s;
  s.x[0] = s.y[0] = 0;
  see(group, above, s);
  return {s.x[0], s.y[0]};
}

bool TexelView::see(const TexelGroup& group, Sightings& s) const {
  const FaceAxes axes = face_axes(group.face);
  float lowest = 1e30f, highest = -1e30f;
  for (const float row : {group.rows[0], group.rows[group.count - 1]})
    for (const int column : {0, group.width - 1}) {
      const float a = group.first_s + group.step * float(column),
                  b = group.first_t + group.step * row;
      const float z = axes.centre.z + a * axes.s.z + b * axes.t.z;
      lowest = std::min(lowest, z), highest = std::max(highest, z);
    }
  if (lowest >= 0) return see(group, true, s);
  if (highest < 0) return see(group, false, s);
  const bool any = see(group, true, s);
  if (!sees_plane_) return any;
  const Sightings other = s;
  const bool more = see(group, false, s);
  for (int i = 0; i < lanes_of(group.count); ++i)
    if (other.seen[i]) {
      s.x[i] = other.x[i], s.y[i] = other.y[i], s.pixels[i] = other.pixels[i];
      s.seen[i] = 1;
    }
  return any || more;
}

}  // namespace fastibl
