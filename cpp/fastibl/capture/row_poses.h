// Where a camera is while a rolling shutter reads its picture.
#pragma once

#include <optional>

#include "fastibl/core/pose.h"

namespace fastibl {

// camera_from_marker by row: the camera's position and rotation change evenly from the first row to
// the last.
class RowPoses {
 public:
  explicit RowPoses(const Pose& first, const std::optional<Pose>& last = {})
      : first_(first), last_(last.value_or(first)), rolling_(!(first_ == last_)) {}

  bool rolling() const { return rolling_; }
  // share: 0 at the first row, 1 at the last.
  Pose at(double share) const;

 private:
  Pose first_, last_;
  bool rolling_;
};

}  // namespace fastibl
