// Pictures drawn larger and averaged, in strips, as they would take much memory at once.
#pragma once

#include <vector>

#include "fastibl/scene/camera.h"
#include "fastibl/scene/object_layer.h"

namespace fastibl {

inline constexpr int kMostSupersampling = 8;

// The camera of a picture that is drawn so many times as large along each axis. Throws
// std::invalid_argument for a scale that is not from 1 to kMostSupersampling.
Camera enlarged(const Camera& camera, int scale);

// Whole rows of a picture, drawn `scale` times as large along each axis.
struct Strip {
  int scale;
  int top;        // row of the picture
  Camera camera;  // of the large strip
};
// Strips from the top, each of about a million large pixels. Throws as enlarged() does.
std::vector<Strip> strips_of(const Camera& camera, int scale);

// Adds a layer of a strip to the picture's: the means of scale × scale pixels each.
void add_strip(const Strip& strip, const ObjectLayer& large, ObjectLayer& layer);

}  // namespace fastibl
