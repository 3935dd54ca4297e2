#include "fastibl/shading/hidden_masks.h"

namespace fastibl {

void HiddenMasks::keep(const std::shared_ptr<const VertexVisibility>& visibility, int size) {
  if (visibility == visibility_ && size == size_) return;
  visibility_ = visibility, size_ = size;
  const std::size_t groups = std::size_t(size) * std::size_t(size) / HiddenCells::kGroup;
  masks_.assign(groups, 0);  // of entries from which nothing is hidden
  first_.assign(visibility->entries(), 0);
  HiddenCells hidden(size);
  for (std::size_t e = 0; e < first_.size(); ++e) {
    if (visibility->edges_of(e).empty()) continue;
    hidden.set(visibility->edges_of(e), visibility->size);
    first_[e] = masks_.size();
    masks_.insert(masks_.end(), hidden.masks(), hidden.masks() + groups);
  }
}

}  // namespace fastibl
