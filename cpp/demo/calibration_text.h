// The text of calibration files, checked so that OpenCV's parser can safely read it, whoever wrote
// it.
#pragma once

#include <filesystem>
#include <string>

namespace fastibl::demo {

// OpenCV's parser calls itself for every level until memory runs out, and may read some binary data
// forever. Its own writer of calibrations produces neither deep levels nor binary data, so both are
// refused. Throws std::invalid_argument that names the file, also for one that is missing or too
// large.
std::string calibration_text(const std::filesystem::path& path);

}  // namespace fastibl::demo
