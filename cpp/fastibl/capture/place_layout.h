// Where things are around the object: as told, or as pictures from several places show it.
#pragma once

#include <optional>
#include <vector>

#include "fastibl/capture/camera_side.h"
#include "fastibl/capture/capture_options.h"
#include "fastibl/capture/light_tracks.h"
#include "fastibl/capture/sphere_sweep.h"
#include "fastibl/capture/surroundings.h"
#include "fastibl/capture/texel_view.h"
#include "fastibl/core/vector.h"
#include "fastibl/scene/light_position.h"
#include "fastibl/scene/map_surface.h"
#include "fastibl/scene/room_box.h"

namespace fastibl {

class PlaceLayout {
 public:
  PlaceLayout(const CaptureOptions& options, const TileOutlines& outlines);

  const glm::dvec3& centre() const { return centre_; }  // of the map
  const Surroundings& surroundings() const { return surroundings_; }
  const MapSurface& surface() const { return surroundings_.surface(); }
  // The room's walls as they now stand to the marker, if they were given.
  std::optional<RoomBox> told_box() const { return told_box_ ? surface().box() : std::nullopt; }
  const LightTracks& tracks() const { return tracks_; }
  Viewpoint viewpoint() const { return {centre_, surroundings_, masked_}; }
  bool on_page(const glm::dvec2& point) const;  // whether a point of the plane is on the board

  void find_distance(bool find) { find_surface_ = find; }

  // Compares a picture with earlier ones, and says where things are if that is not where they were
  // thought to be. Only where neither a distance nor a box was given.
  std::optional<MapSurface> find_surface(const PosedPicture& posed);
  // Returns what was before.
  Surroundings move_to(const MapSurface& surface, const TileOutlines& outlines);
  // Looks for lights that are brighter than `bright` (radiance). Returns the tiles that now show
  // another light than before.
  std::vector<int> locate_lights(const PosedPicture& posed, const TileOutlines& outlines,
                                 double exposure, double bright, double time);
  // For when the marker was turned: walls turn, and lights must be located anew.
  void turn(const glm::dmat3& new_from_old, const TileOutlines& outlines);

  struct Parallax {
    double expected = 0, doubt = 0;  // of the irradiance
  };
  Parallax parallax() const;

 private:
  glm::dvec3 centre_;
  // Half width and height of the board's page, and of what is masked with it.
  glm::dvec2 page_{-1}, masked_{-1};
  bool find_surface_, told_box_, locate_lights_;
  Surroundings surroundings_;
  SphereSweep sweep_;
  LightTracks tracks_;
  double far_ = 0, looks_ = 0;  // metres from the centre, summed over pictures; their number
};

}  // namespace fastibl
