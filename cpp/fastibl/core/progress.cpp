#include "fastibl/core/progress.h"

#include <algorithm>

#include "fastibl/core/parallel.h"

namespace fastibl {

const char* WorkEnded::what() const noexcept { return "the work was ended"; }

void tell(const Progress& progress, float done) {
  if (progress && !progress(done)) throw WorkEnded();
}

Progress part_of(const Progress& whole, float begin, float end) {
  if (!whole) return {};
  return [whole, begin, end](float done) { return whole(begin + (end - begin) * done); };
}

void parallel_for(const Progress& progress, int at_once, int count, int grain,
                  const std::function<void(int begin, int end)>& body) {
  if (!progress) return parallel_for(count, grain, body);
  for (int first = 0; first < count; first += at_once) {
    tell(progress, float(first) / float(count));
    parallel_for(std::min(at_once, count - first), grain,
                 [&](int begin, int end) { body(first + begin, first + end); });
  }
}

}  // namespace fastibl
