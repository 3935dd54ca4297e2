#include "fastibl/render/scene_samples.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numbers>
#include <optional>
#include <span>
#include <utility>

#include "fastibl/core/parallel.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/shading/sample_cells.h"
#include "fastibl/shading/triangle_place.h"

namespace fastibl {
namespace {

constexpr int kAtOnce = 64;       // samples between two words of the progress
constexpr float kOffset = 1e-4f;  // of the object's size: how far above a surface rays start
// Share of a picture that the object takes. It sets how much of the plane is looked at.
constexpr double kObjectShare = 0.15;

// Fractional part of start + index · step.
float fraction(float start, int index, double step) {
  const double value = double(start) + index * step;
  return float(value - std::floor(value));
}

// The pose without its turn about z.
Pose upright(const Pose& pose) {
  const glm::dmat3& m = pose.rotation;
  const double yaw = std::atan2(m[0][1], m[0][0]), c = std::cos(yaw), s = std::sin(yaw);
  const glm::dmat3 back(glm::dvec3(c, -s, 0), glm::dvec3(s, c, 0), glm::dvec3(0, 0, 1));
  Pose result = pose;
  glm::dmat3 tilt = back * m;
  double off = 0;  // a turn about z alone must leave nothing, however it was rounded
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) off = std::max(off, std::abs(tilt[i][j] - (i == j ? 1.0 : 0.0)));
  if (off < 1e-6) tilt = glm::dmat3(1);
  result.rotation = tilt;
  return result;
}

void set_directions(SceneSamples& samples) {
  constexpr int n = SceneSamples::kLevelSize;
  const std::vector<double> angles = texel_solid_angles(n);
  for (int f = 0; f < 6; ++f)
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x) {
        samples.directions.push_back(glm::normalize(texel_direction(f, x, y, n)));
        samples.solid_angles.push_back(float(angles[std::size_t(y * n + x)]));
      }
}

// The object where it stands.
struct Standing {
  Mesh mesh;
  std::vector<glm::vec3> normals;
  Bounds box;
  float size;
};

// How the object is seen. Rays go by number: any number will do.
struct View {
  glm::vec3 eye;
  int wanted;                                    // pixels
  std::function<std::optional<Ray>(int)> ray;    // through any place
  std::function<std::vector<Ray>(int)> samples;  // of the pixel there
};

// Views from afar, on a circle at an elevation.
void add_views(const Standing& object, int count, float elevation, int wanted,
               std::vector<View>& views) {
  constexpr float kFar = 1e4f;  // times the object's size
  const float c = std::cos(elevation), s = std::sin(elevation);
  const float radius = object.box.radius();
  const glm::vec3 centre = object.box.centre();
  for (int v = 0; v < count; ++v) {
    const float azimuth = 2 * std::numbers::pi_v<float> * (float(v) + 0.3f) / float(count);
    const glm::vec3 to{c * std::cos(azimuth), c * std::sin(azimuth), s};
    const glm::vec3 right = glm::normalize(glm::cross(glm::vec3(0, 0, 1), to));
    const glm::vec3 up = glm::cross(to, right);
    const int first = int(views.size()) * 1009;
    // Even over the disc that holds the object: Roberts 2018, R2.
    const auto ray = [=](int k) {
      const float r = radius * std::sqrt(fraction(0.5f, first + k, 0.7548776662));
      const float t = 2 * std::numbers::pi_v<float> * fraction(0.0f, first + k, 0.5698402910);
      const glm::vec3 from =
          centre + 2 * radius * to + r * std::cos(t) * right + r * std::sin(t) * up;
      return std::optional(Ray{from, -to});
    };
    views.push_back(
        {centre + kFar * radius * to, wanted, ray, [=](int k) { return std::vector{*ray(k)}; }});
  }
}

// The view of one picture. place: of the object on the plane.
View view_of(const Camera& camera, const Pose& camera_from_marker, glm::dvec2 place) {
  const glm::dmat3 marker_from_camera = glm::transpose(camera_from_marker.rotation);
  const glm::vec3 eye(-(marker_from_camera * camera_from_marker.translation) -
                      glm::dvec3(place, 0));
  // In pixels: Roberts 2018, R2.
  const auto place_of = [width = camera.width, height = camera.height](int k) {
    return glm::dvec2(width * fraction(0.5f, k, 0.7548776662),
                      height * fraction(0.5f, k, 0.5698402910));
  };
  const auto through = [=, lens = Lens(camera)](glm::dvec2 pixel) -> std::optional<Ray> {
    const auto d = lens.unproject(pixel);
    if (!d) return std::nullopt;
    return Ray{eye, glm::vec3(glm::normalize(marker_from_camera * *d))};
  };
  const auto samples = [=](int k) {
    const glm::dvec2 corner = glm::floor(place_of(k));
    std::vector<Ray> rays;
    for (int i = 0; i < kSamples; ++i)
      if (const auto ray =
              through(corner + glm::dvec2(kSampleX[i], kSampleY[i]) / double(kSubpixel)))
        rays.push_back(*ray);
    return rays;
  };
  return {eye, SceneSamples::kPicturePixels, [=](int k) { return through(place_of(k)); }, samples};
}

// Vertices, with whether their back is seen, and their indices among those that are kept.
using Sides = std::map<std::pair<int, bool>, int>;

// Where a ray of a view meets the object.
std::optional<SceneSamples::Surface> surface_at(const Scene& scene, const Standing& object,
                                                const SceneSamples& samples, const Ray& ray,
                                                int view, Sides& used) {
  const Bvh::Hit hit = samples.bvh->nearest(ray);
  if (hit.triangle < 0) return std::nullopt;
  const glm::ivec3 triangle = object.mesh.triangles[std::size_t(hit.triangle)];
  const glm::vec3 w(1 - hit.u - hit.v, hit.u, hit.v);
  glm::vec3 corners[3], n(0), p(0);
  for (int i = 0; i < 3; ++i) {
    corners[i] = object.mesh.vertices[std::size_t(triangle[i])];
    n += w[i] * object.normals[std::size_t(triangle[i])], p += w[i] * corners[i];
  }
  if (!(glm::dot(n, n) > 1e-12f)) return std::nullopt;
  n = glm::normalize(n);
  const glm::vec3 to_eye = glm::normalize(samples.eyes[std::size_t(view)] - p);
  const glm::vec3 facing = glm::cross(corners[1] - corners[0], corners[2] - corners[0]);
  const bool behind = glm::dot(facing, to_eye) < 0;
  if (behind && scene.fronts_only) return std::nullopt;  // a ray that slipped between two triangles
  SceneSamples::Surface sample{{},
                               w,
                               p,
                               behind ? -n : n,
                               p,
                               to_eye,
                               view,
                               glm::vec4(0),
                               glm::vec2(0),
                               glm::vec3(scene.mesh.colors.empty() ? 1 : 0)};
  for (int i = 0; i < 3; ++i) {
    const std::size_t corner = std::size_t(triangle[i]);
    if (!scene.mesh.uvs.empty()) sample.uv += w[i] * scene.mesh.uvs[corner];
    if (!scene.mesh.colors.empty()) sample.color += w[i] * scene.mesh.colors[corner];
    if (!scene.tangents.empty()) {
      const glm::vec4& tangent = scene.tangents[corner];
      sample.tangent += glm::vec4(w[i] * (samples.turned * glm::vec3(tangent)), 0);
      sample.tangent.w = tangent.w;
    }
    sample.corners[i] = used.try_emplace({triangle[i], behind}, int(used.size())).first->second;
  }
  return sample;
}

void add_surface(const Scene& scene, const Standing& object, const std::vector<View>& views,
                 SceneSamples& samples) {
  Sides used;
  int met = 0, tried = 0;
  for (int v = 0; v < int(views.size()); ++v) {
    const View& view = views[std::size_t(v)];
    const bool pictured = v < int(samples.picture_count);
    samples.eyes.push_back(view.eye);
    int found = 0;
    for (int k = 0; found < view.wanted && k < 40 * view.wanted; ++k) {
      const std::size_t first = samples.surface.size();
      int place = 0;
      for (const Ray& ray : view.samples(k)) {
        if (const auto sample = surface_at(scene, object, samples, ray, v, used))
          samples.surface.push_back(*sample), samples.surface.back().place = place;
        ++place;
      }
      const bool any = samples.surface.size() > first;
      found += any;
      if (!pictured) continue;
      tried += 1, met += any;
      if (any) samples.pixels.push_back(first), samples.seen = samples.surface.size();
    }
  }
  samples.pixels.push_back(samples.seen);
  samples.object_area = tried ? double(met) / tried : 0.0;
  // Data of each vertex that is kept, in the order in which samples came to them.
  std::vector<std::pair<int, bool>> order(used.size());
  for (const auto& [side, place] : used) order[std::size_t(place)] = side;
  const VertexVisibility& all = *scene.directions;
  VertexVisibility& kept = samples.visibility;
  kept.size = all.size, kept.first = {0};
  for (const auto& [vertex, behind] : order) {
    const std::size_t i = std::size_t(vertex);
    const std::size_t entry = i + (behind && all.sides > 1 ? all.vertex_count() : 0);
    samples.vertices.push_back(scene.mesh.vertices[i]);
    samples.normals.push_back(behind ? -scene.normals[i] : scene.normals[i]);
    samples.origins.push_back(scene.origins[entry]);
    samples.openness.push_back(scene.visibility[i]);
    const std::span<const std::uint16_t> edges = all.edges_of(entry);
    kept.edges.insert(kept.edges.end(), edges.begin(), edges.end());
    kept.first.push_back(std::uint32_t(kept.edges.size()));
  }
}

glm::vec3 start_of(const Standing& object, const SceneSamples& samples,
                   const SceneSamples::Surface& s) {
  const glm::mat3& turned = samples.turned;
  const glm::vec3 lifted(0, 0, samples.lifted);
  TrianglePlace place{{}, s.weights, s.position, s.normal};
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t corner = std::size_t(s.corners[i]);
    place.corners[i] = {turned * samples.vertices[corner] + lifted,
                        turned * samples.normals[corner],
                        turned * samples.origins[corner] + lifted};
  }
  return ray_start(place, kOffset * object.size);
}

// Which of the asked directions, given by their indices in `directions`, meet the object.
std::vector<std::uint8_t> met_from(const Bvh& bvh, const SceneSamples& samples, glm::vec3 from,
                                   const std::vector<int>& asked) {
  std::vector<std::uint8_t> met(asked.size(), 0);
  if (asked.empty()) return met;
  DirectionSet set(int(asked.size()));
  for (std::size_t k = 0; k < asked.size(); ++k)
    set.set(int(k), samples.directions[std::size_t(asked[k])]);
  bvh.occluded(from, set, 0, met);
  return met;
}

void trace_surface(const Standing& object, const Bvh& bvh, SceneSamples& samples,
                   const Progress& progress) {
  const std::size_t count = samples.direction_count();
  samples.free.assign(samples.surface.size() * count, 0);
  parallel_for(progress, kAtOnce, int(samples.surface.size()), 4, [&](int begin, int end) {
    std::vector<int> above;
    for (int i = begin; i < end; ++i) {
      SceneSamples::Surface& s = samples.surface[std::size_t(i)];
      s.start = start_of(object, samples, s);
      above.clear();
      for (std::size_t k = 0; k < count; ++k)
        if (glm::dot(samples.directions[k], s.normal) > 0) above.push_back(int(k));
      const std::vector<std::uint8_t> met = met_from(bvh, samples, s.start, above);
      std::uint8_t* free = &samples.free[std::size_t(i) * count];
      for (std::size_t k = 0; k < above.size(); ++k) free[above[k]] = !met[k];
    }
  });
}

// A place on the plane, and its area in pictures.
struct SeenPlanePoint {
  glm::vec2 place;
  double area;
};

// Share of the pictures that see this place of the plane.
double share_seen(const Bvh& bvh, glm::vec3 from, std::span<const glm::vec3> eyes) {
  int seen = 0;
  for (const glm::vec3& eye : eyes) seen += !bvh.occluded(Ray{from, glm::normalize(eye - from)});
  return double(seen) / double(eyes.size());
}

// Places within a disc on the plane that, with the object, fills the picture. They are closer
// together towards its middle, where shadows have their edges.
std::vector<SeenPlanePoint> places_all_round(const Standing& object, const Bvh& bvh,
                                             const SceneSamples& samples, int n) {
  constexpr double kPi = std::numbers::pi, kInwards = 0.75;  // 0.5: equally dense everywhere
  const double slope = std::sin(double(SceneSamples::kElevation));
  const std::span<const glm::vec3> eyes = std::span(samples.eyes).first(samples.picture_count);
  const glm::vec3 centre = object.box.centre();
  const double beneath = glm::length(glm::vec2(centre - object.box.lower));
  // An object that hovers has its shadow elsewhere.
  const double reach = std::max(std::sqrt(samples.object_area / kObjectShare / (kPi * slope)),
                                1.2 * beneath + std::max(double(object.box.lower.z), 0.0));
  std::vector<SeenPlanePoint> places;
  for (int i = 0; i < n; ++i) {
    const double u = (i + 0.5) / n, r = reach * std::pow(u, kInwards);
    const double turn = 2 * kPi * fraction(0.0f, i, (std::sqrt(5.0) - 1) / 2);
    const glm::vec2 p = glm::vec2(centre) + glm::vec2(r * std::cos(turn), r * std::sin(turn));
    const double area = 2 * kInwards * kPi * reach * reach * std::pow(u, 2 * kInwards - 1) / n;
    const double seen = area * slope * share_seen(bvh, {p, samples.above}, eyes);
    if (seen > 0) places.push_back({p, seen});
  }
  return places;
}

// Places on the plane that a picture shows.
std::vector<SeenPlanePoint> places_of(const View& view, const Bvh& bvh, int n) {
  std::vector<SeenPlanePoint> places;
  for (int k = 0; k < n; ++k) {
    const std::optional<Ray> ray = view.ray(k);
    if (!ray || !(ray->origin.z * ray->direction.z < 0) || bvh.nearest(*ray).triangle >= 0)
      continue;
    const float distance = -ray->origin.z / ray->direction.z;
    places.push_back({glm::vec2(ray->origin + distance * ray->direction), 1.0 / n});
  }
  return places;
}

void trace_plane(const Standing& object, const Bvh& bvh, const std::vector<SeenPlanePoint>& places,
                 SceneSamples& samples) {
  const float radius = object.box.radius();
  const glm::vec3 centre = object.box.centre();
  samples.plane_first = {0};
  for (const auto& [p, area] : places) {
    const glm::vec3 from(p, samples.above);
    const glm::vec3 to = centre - from;
    const float distance = glm::length(to);
    const float cosine =
        distance > radius ? std::sqrt(1 - radius * radius / (distance * distance)) : -1;
    std::vector<int> asked;
    for (std::size_t k = 0; k < samples.direction_count(); ++k)
      if (samples.directions[k].z > 0 && glm::dot(samples.directions[k], to) >= cosine * distance)
        asked.push_back(int(k));
    samples.plane.push_back(p), samples.plane_areas.push_back(area);
    const std::vector<std::uint8_t> met = met_from(bvh, samples, from, asked);
    for (std::size_t k = 0; k < asked.size(); ++k)
      if (met[k]) samples.hidden.push_back(std::uint16_t(asked[k]));
    samples.plane_first.push_back(std::uint32_t(samples.hidden.size()));
  }
}

// pose: of the object; its place on the plane is ignored. picture: the only view, or null.
std::shared_ptr<const SceneSamples> sample(const Scene& scene, Pose pose, const View* picture,
                                           const Progress& progress) {
  if (!scene.directions || scene.mesh.triangles.empty()) return nullptr;
  auto samples = std::make_shared<SceneSamples>();
  pose.translation.x = pose.translation.y = 0;
  samples->turned = glm::mat3(pose.rotation), samples->lifted = pose.translation.z;
  Standing object{scene.mesh, scene.shown_normals(), {}, 0};
  for (glm::vec3& p : object.mesh.vertices) p = glm::vec3(pose * glm::dvec3(p));
  for (glm::vec3& n : object.normals) n = samples->turned * n;
  object.box = bounds(object.mesh.vertices);
  const glm::vec3 extent = object.box.upper - object.box.lower;
  object.size = std::max({extent.x, extent.y, extent.z});
  if (!(object.size > 0)) return nullptr;
  samples->bvh = std::make_shared<const Bvh>(object.mesh);
  samples->centre = object.box.centre(), samples->radius = object.box.radius();
  samples->above = 1e-5f * object.size;
  const Bvh& bvh = *samples->bvh;
  set_directions(*samples);
  std::vector<View> views;
  if (picture)
    views = {*picture};
  else
    add_views(object, SceneSamples::kViews, SceneSamples::kElevation, SceneSamples::kViewSamples,
              views);
  samples->picture_count = views.size();
  add_views(object, SceneSamples::kViewsFromBelow, -SceneSamples::kElevation,
            SceneSamples::kSamplesFromBelow, views);
  if (picture) samples->part = 1.0f / kSamples;
  add_surface(scene, object, views, *samples);
  if (samples->empty()) return nullptr;
  // From afar all rays of a view start in a disc around the object.
  if (!picture)
    samples->object_area *= std::numbers::pi * double(samples->radius) * double(samples->radius);
  trace_surface(object, bvh, *samples, part_of(progress, 0.1f, 0.7f));
  tell(progress, 0.7f);
  const int count = picture ? SceneSamples::kPicturePlaneSamples : SceneSamples::kPlaneSamples;
  const auto places = [&](int n) {
    return picture ? places_of(*picture, bvh, n) : places_all_round(object, bvh, *samples, n);
  };
  trace_plane(object, bvh, places(count), *samples);
  for (const auto& [p, area] : places(SceneSamples::kClose * count))
    samples->close_plane.push_back(p), samples->close_areas.push_back(area);
  return samples;
}

}  // namespace

glm::vec3 shift_of(const Scene& scene, const SceneSamples& samples) {
  const glm::dvec3 middle =
      (glm::dvec3(samples.centre) - glm::dvec3(0, 0, samples.lifted)) * glm::dmat3(samples.turned);
  return glm::vec3(scene.marker_from_object * middle - glm::dvec3(samples.centre));
}

std::shared_ptr<const SceneSamples> sample_scene(const Scene& scene, const Progress& progress) {
  return sample(scene, upright(scene.marker_from_object), nullptr, progress);
}

std::shared_ptr<const SceneSamples> sample_scene(const Scene& scene, const Camera& camera,
                                                 const Pose& camera_from_marker) {
  const View view =
      view_of(camera, camera_from_marker, glm::dvec2(scene.marker_from_object.translation));
  return sample(scene, scene.marker_from_object, &view, {});
}

}  // namespace fastibl
