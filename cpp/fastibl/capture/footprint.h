// Reads a picture under the footprints of a group of texels.
#pragma once

#include "fastibl/capture/frame_levels.h"
#include "fastibl/capture/texel_state.h"
#include "fastibl/capture/texel_view.h"

namespace fastibl {

// Number of levels that footprints of up to this many pixels read.
int levels_for(float most_pixels);
// Columns [x0, x1) and rows [y0, y1) of a picture; may reach beyond it.
struct PixelBox {
  int x0, y0, x1, y1;
};
// What is read of a picture for a footprint of so many pixels around a place.
PixelBox footprint_box(float x, float y, float pixels);
// Fills `linear`, `clipped`, `spread` and the flags of `samples` where texels were seen. light: a
// linear value. A group of texels at the rim of something brighter than that is read more finely,
// and so is one for which another exposure showed this (`fine`): footprints of one shape agree.
// True if this picture shows it.
bool sample_footprints(const FrameLevels& levels, const Sightings& sightings, int count,
                       float light, bool fine, Samples& samples);

}  // namespace fastibl
