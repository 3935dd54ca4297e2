#include "fastibl/shading/near_lobes.h"

#include <algorithm>
#include <cmath>

#include "fastibl/scene/octahedral.h"
#include "fastibl/scene/shared_formulas.h"
#include "fastibl/shading/light_disc.h"

namespace fastibl {

NearLobes::NearLobes(const Scene& scene, const NearShares& shares, const CellLight& light,
                     glm::vec3 mean_radiance, const LobeShape& lobe)
    : flux_(light.flux()), height_(lobe, 1e6f) {
  height_.f0 = 1;  // as for the cells
  const glm::mat3 back = glm::transpose(glm::mat3(scene.marker_from_object.rotation));
  centre_ = back * (shares.centre() - glm::vec3(scene.marker_from_object.translation));
  const std::vector<glm::vec3>& directions = octahedral_grid(light.size()).directions();
  const float half_cell = std::sqrt(kPi) / float(light.size());
  const float whole = 4 * kPi * (mean_radiance.x + mean_radiance.y + mean_radiance.z);
  for (const NearShares::OfLight& of : shares.lights()) {
    const NearLight& l = of.light;
    if (of.open.empty() || !(l.inverse_distance > 0) || !(whole > 0)) continue;
    const glm::vec3 towards = back * l.direction;
    const float reach = std::asin(std::min(l.sin_radius, 1.0f)) + half_cell;
    std::vector<std::size_t> cells;
    float there = 0;
    for (std::size_t k = 0; k < directions.size(); ++k)
      if (glm::dot(directions[k], towards) >= std::cos(reach))
        cells.push_back(k), there += flux_[k];
    const float own = (l.irradiance.x + l.irradiance.y + l.irradiance.z) / whole;
    const float part = there > 0 ? std::min(own / there, 1.0f) : 0;
    for (const std::size_t k : cells) flux_[k] *= 1 - part;
    if (part > 0) lights_.push_back({towards, l.inverse_distance, l.sin_radius, part * there, &of});
  }
}

void NearLobes::add(std::size_t entry, glm::vec3 position, glm::vec3 normal, glm::vec3 view,
                    LobeCells::Sums& sums) const {
  for (const Light& l : lights_) {
    const glm::vec3 arrow = shared::near_arrow(l.direction, l.inverse_distance, position - centre_);
    const float seen = disc_in_lobe(arrow, l.sin_radius, l.flux, normal, view, height_);
    sums.all += seen, sums.lost += (1 - l.of->open[entry]) * seen;
  }
}

}  // namespace fastibl
