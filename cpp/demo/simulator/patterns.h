// How the room's walls are painted: plain functions of the place on a wall.
#pragma once

#include "demo/simulator/surface.h"

namespace fastibl::demo {

// a: metres to the right, b: metres up (walls), or along x and y (floor, ceiling, table).
Paint shelf_wall(float a, float b);
Paint door_wall(float a, float b);
Paint picture_wall(float a, float b);
Paint window_wall(float a, float b);
Paint ceiling(float a, float b);
Paint floor_boards(float a, float b);
Paint table_top(float a, float b);

}  // namespace fastibl::demo
