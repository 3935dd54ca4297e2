// Sets of numbers, joined as their members are found to belong together.
#pragma once

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <vector>

namespace fastibl {

class DisjointSets {
 public:
  explicit DisjointSets(std::size_t count) : parents_(count) {
    std::iota(parents_.begin(), parents_.end(), 0);
  }
  // The lowest of the numbers that are in a set with this one.
  int lowest(int i) {
    while (parents_[std::size_t(i)] != i)  // halves the path for the next
      i = parents_[std::size_t(i)] = parents_[std::size_t(parents_[std::size_t(i)])];
    return i;
  }
  void join(int a, int b) {
    a = lowest(a), b = lowest(b);
    parents_[std::size_t(std::max(a, b))] = std::min(a, b);
  }

 private:
  std::vector<int> parents_;
};

}  // namespace fastibl
