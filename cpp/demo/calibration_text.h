// Text of calibration files that OpenCV's parser can be given, whoever wrote them.
#pragma once

#include <filesystem>
#include <string>

namespace fastibl::demo {

// OpenCV's parser calls itself for every level, until no memory is left for that, and may read some
// binary data for ever: neither comes from its own writer of calibrations. Throws
// std::invalid_argument that names the file, also for one that is missing or too large.
std::string calibration_text(const std::filesystem::path& path);

}  // namespace fastibl::demo
