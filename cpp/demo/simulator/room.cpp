#include "demo/simulator/room.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "demo/simulator/patterns.h"
#include "fastibl/core/parallel.h"

namespace fastibl::demo {
namespace {

constexpr glm::vec3 kLower(-2.6f, -2.0f, 0.0f), kUpper(3.4f, 3.0f, 2.6f);  // metres
constexpr glm::vec2 kTable(0.8f, 0.55f);                                   // half sizes, metres
constexpr float kTableDensity = 500;                                       // texels per metre
constexpr int kCells = 12;                  // cells of irradiance along an edge
constexpr int kAround = 48, kUpwards = 24;  // directions from which light is gathered
constexpr int kReflections = 3;
constexpr glm::vec3 kLamp(0.9f, -2.0f, 1.25f);  // its centre, on the wall y = −2
constexpr float kLampRadius = 0.12f;            // metres
constexpr glm::vec3 kLampRadiance(700, 560, 385);

// Side k of the box; the pictures of walls run to the right and up.
Surface side(int k) {
  const int axis = k / 2;
  const int a = axis == 0 ? 1 : 0, b = axis == 2 ? 1 : 2;
  Surface surface;
  surface.origin = kLower;
  surface.origin[axis] = k % 2 ? kUpper[axis] : kLower[axis];
  surface.u[a] = 1, surface.v[b] = 1;
  surface.normal[axis] = k % 2 ? -1.0f : 1.0f;
  surface.size = {kUpper[a] - kLower[a], kUpper[b] - kLower[b]};
  return surface;
}

// Cosine-weighted directions around +z, one for each cell of equal weight.
const std::vector<glm::vec3>& cosine_directions() {
  static const std::vector<glm::vec3> all = [] {
    std::vector<glm::vec3> directions;
    for (int i = 0; i < kUpwards; ++i)
      for (int j = 0; j < kAround; ++j) {
        const float r2 = (float(i) + 0.5f) / kUpwards, r = std::sqrt(r2);
        const float turn = 2 * kPi * (float(j) + 0.5f * float(i % 2)) / kAround;
        directions.emplace_back(r * std::cos(turn), r * std::sin(turn), std::sqrt(1 - r2));
      }
    return directions;
  }();
  return all;
}

}  // namespace

Room::Room(bool lamp) : lamp_(lamp) {
  constexpr std::array paints = {window_wall, door_wall,    picture_wall,
                                 shelf_wall,  floor_boards, ceiling};
  for (int k = 0; k < 6; ++k) {
    sides_[std::size_t(k)] = side(k);
    paint(sides_[std::size_t(k)], paints[std::size_t(k)]);
  }
  table_ = side(4);
  table_.origin = {-kTable, 0};
  table_.size = 2.0f * kTable;
  table_.density = kTableDensity;
  paint(table_, table_top);
  light();
}

glm::vec3 Room::from_lamp(const glm::vec3& place, const glm::vec3& normal) const {
  if (!lamp_) return glm::vec3(0);
  const glm::vec3 to = kLamp - place;
  const float d2 = glm::dot(to, to), cos_there = -to.y, cos_here = glm::dot(normal, to);
  if (cos_here <= 0 || cos_there <= 0) return glm::vec3(0);
  return kLampRadiance * (kPi * kLampRadius * kLampRadius * cos_here * cos_there / (d2 * d2));
}

glm::vec3 Room::gather(const glm::vec3& place, const glm::vec3& normal) const {
  const glm::vec3 t = std::abs(normal.x) < 0.5f ? glm::vec3(1, 0, 0) : glm::vec3(0, 1, 0);
  const glm::vec3 b = glm::cross(normal, t);
  glm::dvec3 sum(0);
  for (const glm::vec3& d : cosine_directions()) {
    const glm::vec3 to = d.x * t + d.y * b + d.z * normal;
    sum += glm::dvec3(sent_by(leave(place, to.x, to.y, to.z), false));
  }
  return glm::vec3(sum * (std::numbers::pi / double(cosine_directions().size())));
}

void Room::light() {
  std::array<Surface*, 7> all;
  for (std::size_t k = 0; k < 6; ++k) all[k] = &sides_[k];
  all[6] = &table_;
  for (Surface* s : all) s->radiance = s->emission, s->irradiance = Image<float>(kCells, kCells, 4);
  for (int round = 0; round < kReflections; ++round) {
    parallel_for(7 * kCells, 1, [&](int begin, int end) {
      for (int k = begin; k < end; ++k)
        for (int x = 0; x < kCells; ++x) {
          Surface& s = *all[std::size_t(k / kCells)];
          const glm::vec2 at = (glm::vec2(x, k % kCells) + 0.5f) / float(kCells) * s.size;
          const glm::vec3 place = s.point(at.x, at.y) + 1e-3f * s.normal;
          const glm::vec3 e = gather(place, s.normal) + from_lamp(place, s.normal);
          for (int c = 0; c < 3; ++c) s.irradiance.pixel(x, k % kCells)[c] = e[c];
        }
    });
    for (Surface* s : all)
      parallel_for(s->albedo.height, 16, [&](int begin, int end) {
        for (int y = begin; y < end; ++y)
          for (int x = 0; x < s->albedo.width; ++x) {
            const glm::vec3 e =
                irradiance_at(*s, (float(x) + 0.5f) / s->density, (float(y) + 0.5f) / s->density);
            for (int c = 0; c < 3; ++c)
              s->radiance.pixel(x, y)[c] =
                  s->emission.pixel(x, y)[c] + s->albedo.pixel(x, y)[c] * e[c] / kPi;
          }
      });
  }
}

Room::Hit Room::leave(const glm::vec3& place, float x, float y, float z) {
  // Distances to the wall ahead along each axis; infinite if the ray does not move along it.
  const float to_x = std::abs((x > 0 ? kUpper.x : kLower.x) - place.x) / std::abs(x);
  const float to_y = std::abs((y > 0 ? kUpper.y : kLower.y) - place.y) / std::abs(y);
  const float to_z = std::abs((z > 0 ? kUpper.z : kLower.z) - place.z) / std::abs(z);
  float to = to_x;
  int side = x > 0 ? 1 : 0;
  side = to_y < to ? (y > 0 ? 3 : 2) : side, to = to_y < to ? to_y : to;
  side = to_z < to ? (z > 0 ? 5 : 4) : side, to = to_z < to ? to_z : to;
  const float hit_x = place.x + to * x - kLower.x, hit_y = place.y + to * y - kLower.y;
  const float hit_z = place.z + to * z - kLower.z;
  return {side, side < 2 ? hit_y : hit_x, side < 4 ? hit_z : hit_y};
}

glm::vec3 Room::sent_by(const Hit& hit, bool lamp) const {
  if (hit.side == 4) {
    const float x = hit.a + kLower.x, y = hit.b + kLower.y;
    if (std::abs(x) < kTable.x && std::abs(y) < kTable.y)
      return radiance_at(table_, x + kTable.x, y + kTable.y);
  }
  if (hit.side == 2) {
    const glm::vec2 off(hit.a + kLower.x - kLamp.x, hit.b + kLower.z - kLamp.z);
    if (glm::dot(off, off) < kLampRadius * kLampRadius)
      return lamp ? kLampRadiance : glm::vec3(0.4f);  // a lamp shade, lit by the room
  }
  return radiance_at(sides_[std::size_t(hit.side)], hit.a, hit.b);
}

void Room::radiance(const glm::vec3& place, const Rays& directions, glm::vec3* out) const {
  constexpr int kBlock = 64;
  std::array<Hit, kBlock> hits;
  const int count = int(directions.x.size());
  for (int first = 0; first < count; first += kBlock) {
    const int some = std::min(kBlock, count - first);
    const float* x = &directions.x[std::size_t(first)];
    const float* y = &directions.y[std::size_t(first)];
    const float* z = &directions.z[std::size_t(first)];
    for (int k = 0; k < some; ++k) hits[std::size_t(k)] = leave(place, x[k], y[k], z[k]);
    for (int k = 0; k < some; ++k) out[first + k] = sent_by(hits[std::size_t(k)], lamp_);
  }
}

glm::vec3 Room::table_irradiance(glm::vec2 place) const {
  return irradiance_at(table_, place.x + kTable.x, place.y + kTable.y);
}

CubeMap Room::environment(const glm::vec3& place, int size, int samples) const {
  CubeMap map(size);
  const float step = 1.0f / float(size * samples);
  parallel_for(6 * size, 1, [&](int begin, int end) {
    for (int row = begin; row < end; ++row)
      for (int x = 0; x < size; ++x) {
        glm::vec3 sum(0);
        for (int k = 0; k < samples * samples; ++k) {
          const float s = (float(x * samples + k % samples) + 0.5f) * step;
          const float t = (float(row % size * samples + k / samples) + 0.5f) * step;
          sum += radiance(place, face_direction(row / size, s, t));
        }
        map.base().texel(row / size, x, row % size) = sum / float(samples * samples);
      }
  });
  map.base().update_border();
  map.update();
  return map;
}

}  // namespace fastibl::demo
