// The columns of a recording's tables of numbers, as described in docs/files.md.
#pragma once

#include <string_view>

namespace fastibl::demo {

inline constexpr std::string_view kAttitudeColumns = "time,m00,m01,m02,m10,m11,m12,m20,m21,m22";
inline constexpr std::string_view kPoseColumns =
    "time,m00,m01,m02,m03,m10,m11,m12,m13,m20,m21,m22,m23";

}  // namespace fastibl::demo
