// The room that explains how pictures taken from several places differ.
#pragma once

#include <optional>
#include <span>

#include "fastibl/capture/swept_costs.h"
#include "fastibl/scene/room_box.h"

namespace fastibl {

// The box around the centre, at any yaw, whose walls have the least cost; walls that were not seen
// stay about `usual` (1 / metres) away. The floor is the marker's plane. Without `from`, or if
// asked to, it is searched everywhere; `from` is a start in any case.
RoomBox fit_room(std::span<const SweptCosts::Part> parts, const glm::dvec3& centre, double usual,
                 const std::optional<RoomBox>& from, bool everywhere);

}  // namespace fastibl
