// Progress of work that takes long.
#pragma once

#include <exception>
#include <functional>

namespace fastibl {

// Called in the calling thread with the part that is done, 0 to 1; returning false ends the work.
using Progress = std::function<bool(float)>;

// What work throws that its Progress ended, where it returns no optional.
struct WorkEnded : std::exception {
  const char* what() const noexcept override;
};

// Throws WorkEnded where `progress`, which may be empty, ends the work.
void tell(const Progress& progress, float done);

// The progress of a part of the work, which goes from `begin` to `end` of the whole.
Progress part_of(const Progress& whole, float begin, float end);

// parallel_for of core/parallel.h that tells its progress before each `at_once` indices, a multiple
// of `grain`; what it throws, it throws then.
void parallel_for(const Progress& progress, int at_once, int count, int grain,
                  const std::function<void(int begin, int end)>& body);

}  // namespace fastibl
