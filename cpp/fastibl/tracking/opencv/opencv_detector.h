// Tag detection by OpenCV. Component fastibl::tracking; OpenCV's headers are not needed to use it.
#pragma once

#include "fastibl/tracking/detector.h"

namespace fastibl {

struct OpenCvDetectorOptions {
  bool subpixel = true;  // OpenCV's corner refinement by gradients; a start for refine_corners
  // Shortest perimeter of a tag to look for, in units of the picture's longer side.
  double smallest_perimeter = 0.03;
};

// Finds tags of family 36h11, and a starting pose by SQPnP (not IPPE, which fails on a board seen
// exactly fronto-parallel). The function may be called from several threads.
Detector opencv_detector(const OpenCvDetectorOptions& options = {});

// Version of OpenCV that this was built with, "4.6.0".
const char* opencv_version();

}  // namespace fastibl
