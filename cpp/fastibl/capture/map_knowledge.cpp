#include "fastibl/capture/map_knowledge.h"

#include <algorithm>
#include <numbers>

namespace fastibl {
namespace {

constexpr double kKnownPlane = 0.1;  // share of the plane's half that tells its albedo

// How little of the plane was seen, 0 to 1, from the solid angle of its seen part.
double little_of(double seen) {
  return std::max(0.0, 1 - seen / (kKnownPlane * 2 * std::numbers::pi));
}

}  // namespace

MapShares shares_of(const MapTiles& map, const MapFills& fills) {
  double up = 0, up_seen = 0, seen = 0, bound = 0, bound_flux = 0, up_flux = 0, flux = 0,
         unseen = 0;
  double from_prior = 0, plane_seen = 0, plane_unseen = 0;
  for (int tile = 0; tile < map.grid().count(); ++tile) {
    const std::size_t i = std::size_t(tile);
    const TileSums& s = map.sums[i];
    const double filled = fills.flux(tile, map);
    const double all = s.flux.x + s.flux.y + s.flux.z + filled;
    seen += s.angle, bound += s.bound_angle, flux += all, unseen += filled;
    if (!map.above(tile)) {
      plane_seen += s.angle, plane_unseen += filled;
      continue;
    }
    from_prior += fills.has_prior() ? filled : 0;
    up += map.geometry.tile_angle[i], up_seen += s.angle;
    bound_flux += s.bound_flux, up_flux += all;
  }
  const ClippedLights& lights = fills.clipped_lights();
  const double boosted = lights.boosted(), doubt = lights.doubt();
  flux += boosted, up_flux += boosted;
  MapShares shares;
  // Sums of texels' angles differ from those of tiles by rounding.
  shares.coverage = std::min(seen / (4 * std::numbers::pi), 1.0);
  shares.clipped = seen > 0 ? bound / seen : 0;
  MapKnowledge& knowledge = shares.knowledge;
  knowledge.unseen_sky = std::max(1 - up_seen / up, 0.0);
  knowledge.unseen_flux = flux > 0 ? unseen / flux : 1;
  knowledge.guessed_plane = flux > 0 ? little_of(plane_seen) * plane_unseen / flux : 0;
  knowledge.bound_flux = up_flux > 0 ? bound_flux / up_flux : 0;
  knowledge.weighed_flux = up_flux > 0 && fills.boosts() ? lights.weighed() / up_flux : 0;
  knowledge.weighed_spread = lights.spread();
  knowledge.bound_doubt = doubt > 0 ? doubt / (up_flux + doubt) : 0;
  knowledge.prior_flux = flux > 0 ? from_prior / flux : 0;
  knowledge.boosted_flux = up_flux > 0 ? boosted / up_flux : 0;
  return shares;
}

}  // namespace fastibl
