// What an object keeps from itself of the brightest parts of the light, by rays from every pixel
// for which its vertices do not tell.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "fastibl/core/pose.h"
#include "fastibl/scene/camera.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/irradiance.h"
#include "fastibl/scene/material.h"
#include "fastibl/scene/scene.h"
#include "fastibl/shading/bright_cells.h"
#include "fastibl/shading/hidden_masks.h"
#include "fastibl/shading/lobe_cells.h"
#include "fastibl/shading/near_shares.h"
#include "fastibl/shading/near_tracer.h"
#include "fastibl/shading/rasterize.h"
#include "fastibl/shading/self_shadow.h"
#include "fastibl/shading/triangle_place.h"

namespace fastibl {

// Whether what a scene hides from itself is known in the light's cells, and not nothing. shares: of
// the scene's entries.
bool can_ask(const Scene& scene, const CellLight& light, std::span<const glm::vec4> shares);

// The bright cells that hold light of near lights.
class NearCells {
 public:
  NearCells(const NearTracer& near_tracer, const BrightCells& cells);

  std::size_t count() const { return lights_.size(); }  // of the near lights
  // Of a light: the cells, a bit for each; none for a faint one, which is left to the vertices.
  std::uint64_t cells(std::size_t light) const { return lights_[light].cells; }
  // And the part of it that each has, and how much of all light of the map it is.
  std::span<const float> parts(std::size_t light) const { return lights_[light].parts; }
  float flux(std::size_t light) const { return lights_[light].flux; }
  const BrightCells& others() const { return others_; }  // with what else is in them for lobes

 private:
  struct Light {
    std::uint64_t cells = 0;
    std::array<float, BrightCells::kMost> parts;
    float flux = 0;
  };
  std::vector<Light> lights_;
  BrightCells others_;
};

// Shares of the light at places between three corners. Keeps references.
class LightTracer {
 public:
  static constexpr float kSharpest = 1e6f;  // lobe that is summed over rays
  // cells: of the light. irradiance: by which diffuse_shares() found the shares of the corners.
  // near_tracer: lights that are traced to where they are, if any. diffuse: whether shares of the
  // irradiance are to change.
  LightTracer(const Bvh& bvh, const BrightCells& cells, const CellLight& light,
              const Irradiance& irradiance, const Material& material,
              const glm::mat3& map_from_light, const NearTracer* near_tracer = nullptr,
              bool diffuse = true);

  struct Place {
    std::span<const glm::vec3> starts;  // of rays, in the bvh's frame: one, or one a sample
    glm::vec3 normal, view;             // unit, in the light's frame
    glm::vec3 of_others;                // what is not the map's in the share, see EntryShares
    // Where there are near lights: of the corners, and their shares by the map alone.
    NearTracer::Entries entries{};
    std::array<glm::vec3, 3> own{};
  };
  // Changes a share that was interpolated between the corners' shares: of the irradiance (RGB)
  // where light is asked for, see BrightCells::unsure(); and of glossy light, by the place's own
  // lobe, where the corners' lobes meet the object. between: with what is hidden from the corners
  // in cells of mask_size(), where there is a lobe.
  struct Count {
    int traced = 0;  // rays
    int summed = 0;  // of glossy light, by rays and middles of cells
  };
  // What corners do not tell: of bright cells, and of near lights, a bit for each. hides: whether
  // anything of a near light may be hidden.
  struct Asked {
    std::uint64_t cells = 0;
    std::uint32_t near_lights = 0;
    bool hides = false;
    bool any() const { return cells != 0 || near_lights != 0; }
  };
  Asked unsure(const CellStates& a, const CellStates& b, const CellStates& c,
               const NearTracer::Entries& entries = {}) const;
  Count trace(glm::vec4& share, const Place& place, const BrightCells::Corners& corners,
              const LobeCells::Corners& between, Asked asked) const;
  // Whether trace() does anything.
  bool changes(glm::vec4 share, Asked asked) const {
    return (diffuse_ && asked.any()) || glossy(share, asked);
  }
  std::optional<int> mask_size() const {
    return lobe_ ? std::optional(lobe_->size()) : std::nullopt;
  }

 private:
  bool glossy(glm::vec4 share, Asked asked) const {
    return lobe_ && (asked.hides || is_touched(share.w));
  }

  const Bvh& bvh_;
  const BrightCells& cells_;
  const Irradiance& irradiance_;
  glm::mat3 map_from_light_;
  const NearTracer* near_;
  std::optional<NearCells> near_cells_;
  bool diffuse_;
  std::optional<LobeCells> lobe_;  // without the bright cells
  LobeHeight height_;
};

// The bright cells of a map's light, and what every entry of a scene's directions knows of them.
class EntryCells {
 public:
  // Keeps what stays valid from one picture to the next. light: of the map, in the cells of the
  // scene's directions. Returns whether anything changed.
  bool keep(const Scene& scene, const CubeMap& map, const CellLight& light);
  const BrightCells& cells() const { return cells_; }
  const std::vector<CellStates>& states() const { return states_; }  // by entry

 private:
  std::shared_ptr<const VertexVisibility> visibility_;  // that states_ are of
  std::uint64_t light_ = 0;                             // version of the light, likewise
  BrightCells cells_;
  std::vector<CellStates> states_;
  HiddenMasks masks_;  // in the light's cells
};

// The same for all pixels of pictures. Keeps what stays valid from one to the next.
class TracedLights {
 public:
  // Changes the fragments' shares, which were interpolated from diffuse_shares() and
  // glossy_shares(). shares: those of the corners. light: of the map, in the cells of the scene's
  // directions. near_shares: what near lights change in the shares, if anything. diffuse: whether
  // shares of the irradiance change. Does nothing where the scene has no bvh. Returns how many rays
  // it traced.
  double operator()(const Scene& scene, const CubeMap& map, const CellLight& light,
                    const Irradiance& irradiance, const Camera& camera,
                    const Pose& camera_from_marker, const EntryShares& shares,
                    const NearShares* near_shares, std::span<FragmentBand> bands,
                    bool diffuse = true);

 private:
  EntryCells entries_;
  HiddenMasks lobe_masks_;
};

}  // namespace fastibl
