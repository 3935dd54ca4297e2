// What a Capture is told about the place, and how its map is made.
#pragma once

#include <memory>
#include <optional>

#include "fastibl/core/vector.h"
#include "fastibl/scene/board.h"
#include "fastibl/scene/cube_map.h"
#include "fastibl/scene/room_box.h"

namespace fastibl {

struct CaptureOptions {
  int size = 128;              // face edge of the map in texels
  std::optional<Board> board;  // its page is masked, and the plane there is filled from around it
  glm::dvec3 centre{0, 0,
                    0.05};  // metres, z > 0: where the object stands, from which the plane is seen
  // Metres from `centre` to what is seen above the horizon: light from there is placed where the
  // object sees it, not where the camera does. Infinite: all light is distant. std::nullopt: found
  // from how pictures taken from several places differ, and infinite until then; once it is found,
  // so are the walls of a room.
  std::optional<double> distance;
  std::optional<RoomBox> box;  // instead of `distance`: the room's walls, around `centre`
  // Whether lights that several pictures show are triangulated and placed where the object sees
  // them.
  bool locate_lights = true;
  // An earlier map of the place. Its sky stands for what no picture has seen, made as bright as the
  // part that was seen says. Null for none.
  std::shared_ptr<const CubeMap> prior;
  // Whether pictures that are off by one factor all over are first taken for wrongly exposed: see
  // ExposureDoubt. For perspective cameras.
  bool doubt_exposures = false;
  // Texels above the horizon that clip in a camera's shortest exposure are made brighter, by at
  // most this factor, until the map lights the plane as the board's white shows it; 1: not at all.
  // std::nullopt: with cameras that bracket, for which only a sun is left. See ClippedLights.
  std::optional<double> most_boost;
  double paper_albedo = 0.85;  // of the board's white, which serves as a light meter
  double plane_albedo = 0.5;   // of the plane where no camera saw it: radiance albedo · E(z)/π
};

// The options themselves; throws std::invalid_argument for any out of range.
CaptureOptions checked(CaptureOptions options);

}  // namespace fastibl
