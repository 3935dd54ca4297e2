#include "fastibl/lighting/fit_prefiltered_chain.h"

#include <cmath>
#include <utility>

#include "fastibl/lighting/fit_glossy_chain.h"
#include "fastibl/lighting/prefilter.h"

namespace fastibl {
namespace {

// Face sizes of the levels, twice GlossyChain::kSizes: a standard deviation is 3.6 texels from
// level 2 on.
constexpr int kSizes[GlossyChain::kLevelCount] = {0, 128, 128, 64, 32, 16, 8, 4};

}  // namespace

std::shared_ptr<GlossyChain> fit_prefiltered_chain(std::shared_ptr<const CubeMap> map) {
  // Spherical harmonics come with the plain chain; its lobes are replaced by exact ones.
  auto chain = std::make_shared<GlossyChain>(*fit_glossy_chain(map, working_level(*map), {}));
  chain->exact = true;
  std::vector<PrefilterLevel> levels;
  for (int k = 1; k < GlossyChain::kLevelCount; ++k) {
    const double deviation = GlossyChain::kFinestWidth * std::exp2(k - 1);
    levels.push_back({4 / (deviation * deviation), kSizes[k]});  // 2/√s
  }
  PrefilterOptions options;
  options.model = LobeModel::blinn;
  const std::vector<CubeMap> made = prefilter(std::move(map), levels, options);
  for (std::size_t k = 1; k < GlossyChain::kLevelCount; ++k) chain->lobes[k] = made[k - 1].level(0);
  return chain;
}

}  // namespace fastibl
