#include "fastibl/shading/traced_lights.h"

#include <array>
#include <bit>
#include <cmath>
#include <numeric>
#include <optional>

#include "fastibl/core/parallel.h"
#include "fastibl/shading/bake_visibility.h"
#include "fastibl/shading/sample_cells.h"

namespace fastibl {
namespace {

constexpr int kGrain = 512;  // entries

}  // namespace

NearCells::NearCells(const NearTracer& near_tracer, const BrightCells& cells) : others_(cells) {
  for (const NearTracer::Light& l : near_tracer.lights()) {
    Light& of = lights_.emplace_back();
    of.cells = cells.parts_towards(l.direction, l.sin_radius, of.parts);
    if (of.cells != 0) of.flux = others_.leave_out(l.direction, l.sin_radius);
  }
}

LightTracer::LightTracer(const Bvh& bvh, const BrightCells& cells, const CellLight& light,
                         const Irradiance& irradiance, const Material& material,
                         const glm::mat3& map_from_light, const NearTracer* near_tracer,
                         bool diffuse)
    : bvh_(bvh),
      cells_(cells),
      irradiance_(irradiance),
      map_from_light_(map_from_light),
      near_(near_tracer),
      diffuse_(diffuse && material.reads_irradiance()),
      height_(material.lobe(), kSharpest) {
  height_.f0 = 1;  // as for the other cells
  if (near_) near_cells_.emplace(*near_, cells);
  if (const std::optional<LobeShape> lobe = material.lobe())
    lobe_.emplace(light, *lobe, cells.indices());
}

LightTracer::Asked LightTracer::unsure(const CellStates& a, const CellStates& b,
                                       const CellStates& c,
                                       const NearTracer::Entries& entries) const {
  Asked asked{BrightCells::unsure(a, b, c)};
  if (!near_cells_) return asked;
  const bool bent = near_->bent(entries);
  for (std::size_t i = 0; i < near_cells_->count(); ++i) {
    const std::uint64_t cells = near_cells_->cells(i);
    if (cells == 0) continue;
    const NearState state = near_->between(near_->lights()[i], entries);
    if (bent || (cells & asked.cells) != 0 || state == NearState::mixed)
      asked.near_lights |= std::uint32_t{1} << i;
    asked.hides |= state == NearState::mixed || state == NearState::hidden;
  }
  return asked;
}

LightTracer::Count LightTracer::trace(glm::vec4& share, const Place& place,
                                      const BrightCells::Corners& corners,
                                      const LobeCells::Corners& between, Asked asked) const {
  const bool glossy = this->glossy(share, asked);
  const BrightCells& others = near_cells_ ? near_cells_->others() : cells_;
  const std::size_t near_lights = near_cells_ ? near_cells_->count() : 0;
  std::array<glm::vec3, 4> irradiance;
  const NearTracer::Place at{place.normal,    place.starts, place.entries,
                             between.weights, irradiance,   place.own};
  LobeCells::Sums sums;
  std::array<float, NearTracer::kMost> in_lobe{}, open, lost{};  // of near lights
  std::uint64_t counted = 0;
  Count count;
  if (glossy) {
    sums = lobe_->sums(place.normal, place.view, between);
    for (std::size_t i = 0; i < near_lights; ++i)
      if (near_cells_->flux(i) > 0)
        sums.all += in_lobe[i] =
            near_->in_lobe(near_->lights()[i], near_cells_->flux(i), at, place.view, height_);
    counted = others.counted(place.normal, place.view, height_, sums.all);
    count.summed = int(cells_.cells().size());
    if (!diffuse_) asked.cells &= counted;
  }
  open.fill(1);
  for (std::size_t i = 0; i < near_lights; ++i)
    if ((diffuse_ && (asked.near_lights >> i & 1) != 0) ||
        in_lobe[i] > BrightCells::kCounts * sums.all)
      open[i] = near_->open(near_->lights()[i], at, count.traced);
  thread_local BrightCells::Seen seen;
  count.traced += cells_.look(bvh_, place.starts, place.normal, corners, asked.cells, seen);
  if (diffuse_ && asked.any()) {
    std::array<glm::vec3, 4> normals;
    for (std::size_t k = 0; k < 3; ++k) normals[k] = map_from_light_ * corners[k].normal;
    normals[3] = map_from_light_ * place.normal;
    evaluate(irradiance_, normals, irradiance);
    // Where a fragment stands for several triangles, its share is their mean.
    const glm::vec3 before = glm::vec3(share) - place.of_others;
    const glm::vec3 change = cells_.change(seen, place.normal, corners, between.weights, irradiance,
                                           before, asked.cells);
    const glm::vec3 of_map = glm::clamp(before + change, glm::vec3(0), glm::vec3(1));
    glm::vec3 of_others = place.of_others;
    if (asked.near_lights != 0) {
      for (std::size_t i = 0; i < near_lights; ++i)
        for (std::uint64_t left = near_cells_->cells(i); left != 0; left &= left - 1) {
          const auto c = std::size_t(std::countr_zero(left));
          lost[i] += near_cells_->parts(i)[c] * seen.lost[c];
        }
      of_others += near_->change(at, asked.near_lights, open, lost);
    }
    share = glm::vec4(glm::max(of_map + of_others, glm::vec3(0)), share.w);
  }
  if (glossy) {
    const LobeCells::Sums bright =
        others.lobe_sums(seen, place.normal, place.view, height_, counted, count.summed);
    sums.all += bright.all, sums.lost += bright.lost;
    for (std::size_t i = 0; i < near_lights; ++i) sums.lost += (1 - open[i]) * in_lobe[i];
    share.w = sums.share();
  }
  return count;
}

bool can_ask(const Scene& scene, const CellLight& light, std::span<const glm::vec4> shares) {
  return scene.directions && !scene.directions->blocks_nothing() &&
         light.size() == scene.directions->size && shares.size() == scene.directions->entries();
}

bool EntryCells::keep(const Scene& scene, const CubeMap& map, const CellLight& light) {
  if (light_ == light.version() && visibility_ == scene.directions) return false;
  light_ = light.version(), visibility_ = scene.directions;
  const glm::mat3 light_from_map = glm::transpose(glm::mat3(scene.marker_from_object.rotation));
  cells_ = BrightCells(map, light, light_from_map, glm::mat3(1));
  states_.assign(scene.directions->entries(), {});
  if (cells_.empty()) return true;
  masks_.keep(scene.directions, light.size());
  const std::size_t vertices = scene.normals.size();
  parallel_for(int(states_.size()), kGrain, [&](int begin, int end) {
    for (std::size_t e = std::size_t(begin); e < std::size_t(end); ++e)
      states_[e] = cells_.states(masks_.of(e),
                                 e < vertices ? scene.normals[e] : -scene.normals[e - vertices]);
  });
  return true;
}

namespace {

// The places that a pixel's samples show, as starts of rays.
class SampleStarts {
 public:
  SampleStarts(const Camera& camera, const Pose& camera_from_mesh, float offset)
      : lens_(camera),
        mesh_from_camera_(glm::transpose(camera_from_mesh.rotation)),
        eye_(camera_from_mesh.inverse().translation),
        offset_(offset) {}

  // In the plane of the fragment's triangle, which may stand for others that are much like it. One
  // start where the fragment is a part of its pixel, of which it is not known what samples see it,
  // or where its triangle is seen edge-on.
  std::span<const glm::vec3> of(const Fragment& f, const TrianglePlace& place) {
    const auto& c = place.corners;
    const glm::dvec3 plane(
        glm::cross(c[1].position - c[0].position, c[2].position - c[0].position));
    const double height = glm::dot(glm::dvec3(c[0].position) - eye_, plane);
    // Towards the eye, which sees the sample: the surface may bend towards it, too.
    constexpr float kLift = 0.3f;
    starts_[0] = ray_start(place, offset_);
    if (f.coverage < 1) return {starts_.data(), 1};
    std::array<glm::vec3, BrightCells::kStarts> all;
    for (int k = 0; k < kSamples; ++k) {
      const auto d = lens_.unproject(
          {f.x + double(kSampleX[k]) / kSubpixel, f.y + double(kSampleY[k]) / kSubpixel});
      if (!d) return {starts_.data(), 1};
      const glm::dvec3 ray = mesh_from_camera_ * *d;
      const double t = height / glm::dot(ray, plane);
      if (!(t > 0) || !std::isfinite(t)) return {starts_.data(), 1};
      const glm::vec3 beside = glm::vec3(eye_ + t * ray) - place.position;
      all[std::size_t(k)] =
          starts_[0] + beside - kLift * glm::length(beside) * glm::vec3(glm::normalize(ray));
    }
    starts_ = all;
    return starts_;
  }

 private:
  Lens lens_;
  glm::dmat3 mesh_from_camera_;
  glm::dvec3 eye_;
  float offset_;
  std::array<glm::vec3, BrightCells::kStarts> starts_;
};
static_assert(kSamples == BrightCells::kStarts);

}  // namespace

double TracedLights::operator()(const Scene& scene, const CubeMap& map, const CellLight& light,
                                const Irradiance& irradiance, const Camera& camera,
                                const Pose& camera_from_marker, const EntryShares& shares,
                                const NearShares* near_shares, std::span<FragmentBand> bands,
                                bool diffuse) {
  if (!scene.bvh || !can_ask(scene, light, shares.own)) return 0;
  entries_.keep(scene, map, light);
  const std::vector<CellStates>& states = entries_.states();
  std::optional<NearTracer> to_near;
  if (near_shares) to_near.emplace(scene, *near_shares);
  const LightTracer tracer(*scene.bvh, entries_.cells(), light, irradiance, scene.material,
                           glm::mat3(scene.marker_from_object.rotation),
                           to_near ? &*to_near : nullptr, diffuse);
  if (tracer.mask_size()) lobe_masks_.keep(scene.directions, *tracer.mask_size());
  const float offset = ray_offset(scene.mesh);
  const FragmentPlaces places(scene);
  const glm::vec3 eye(camera_from_marker.inverse().translation);
  std::vector<double> rays(bands.size(), 0);
  parallel_for(int(bands.size()), 4, [&](int begin, int end) {
    SampleStarts starts(camera, camera_from_marker * scene.marker_from_object, offset);
    for (int i = begin; i < end; ++i)
      for (Fragment& f : bands[std::size_t(i)].object) {
        const std::array<std::size_t, 3> entries = places.entries(f);
        const LightTracer::Asked asked =
            tracer.unsure(states[entries[0]], states[entries[1]], states[entries[2]], entries);
        if (!tracer.changes(f.share, asked)) continue;
        const FragmentPlace at = places.of(f);
        const TrianglePlace& place = at.place;
        BrightCells::Corners corners;
        LobeCells::Corners between{{}, place.weights};
        for (std::size_t k = 0; k < 3; ++k) {
          corners[k] = {states[entries[k]], place.corners[k].normal};
          if (tracer.mask_size()) between.hidden[k] = lobe_masks_.of(entries[k]);
        }
        rays[std::size_t(i)] +=
            tracer
                .trace(f.share,
                       {starts.of(f, place), place.normal, places.view(f, eye),
                        shares.of_others(at), entries, shares.of_map_at(entries)},
                       corners, between, asked)
                .traced;
      }
  });
  return std::accumulate(rays.begin(), rays.end(), 0.0);
}

}  // namespace fastibl
