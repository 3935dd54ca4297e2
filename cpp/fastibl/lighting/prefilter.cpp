#include "fastibl/lighting/prefilter.h"

#include <algorithm>
#include <cmath>

#include "fastibl/core/check.h"
#include "fastibl/core/parallel.h"
#include "fastibl/lighting/fit_irradiance.h"
#include "fastibl/lighting/harmonic_sums.h"
#include "fastibl/lighting/irradiance_sums.h"
#include "fastibl/lighting/lobe_quadtree.h"
#include "fastibl/lighting/lobe_weights.h"
#include "fastibl/lighting/symmetric_sums.h"
#include "fastibl/scene/methods.h"

namespace fastibl {
namespace {

constexpr int kBlock = 4;  // 4 × 4 neighbouring texels of a result share their choice of texels
static_assert(kBlock * kBlock == kOutputs);

// Values of the chosen texels' images, gathered once for all blocks and lobes.
class SymmetricValues {
 public:
  explicit SymmetricValues(const CubeQuadtree& tree) : tree_(tree) {
    for (const QuadtreeLevel& level : tree.levels()) {
      slots_.emplace_back(6 * std::size_t(level.size) * level.size, kNone);
      symmetries_.push_back(
          cube_symmetries(level.size, level.radiance->row_stride(), level.radiance->face_stride()));
    }
  }

  // Makes sure that the texels of all choices are there.
  void gather(std::span<const TexelChoice> choices) {
    struct Wanted {
      int level, face;
      std::uint32_t texel;
    };
    std::vector<Wanted> wanted;
    for (const TexelChoice& choice : choices)
      for (const TexelRun& run : choice.runs)
        for (std::size_t i = run.first; i < run.first + run.count; ++i) {
          std::uint32_t& slot = slot_of(run.level, run.face, choice.texels[i]);
          if (slot != kNone) continue;
          slot = std::uint32_t(values_.size() + wanted.size());
          wanted.push_back({run.level, run.face, choice.texels[i]});
        }
    const std::size_t first = values_.size();
    values_.resize(first + wanted.size());
    parallel_for(int(wanted.size()), 256, [&](int begin, int end) {
      for (int i = begin; i < end; ++i) {
        const Wanted& w = wanted[std::size_t(i)];
        const CubeLevel& level = *tree_.levels()[std::size_t(w.level)].radiance;
        const int x = int(w.texel) % level.size(), y = int(w.texel) / level.size();
        SymmetricTexel& to = values_[first + std::size_t(i)];
        for (int g = 0; g < kCubeSymmetries; ++g) {
          const CubeSymmetry& symmetry = symmetries_[std::size_t(w.level)][std::size_t(g)];
          const glm::vec3& value = level.face(0)[symmetry[std::size_t(w.face)](x, y)];
          for (int c = 0; c < 3; ++c) to.values[c][g] = value[c];
        }
      }
    });
  }

  std::uint32_t& slot_of(int level, int face, std::uint32_t texel) {
    const std::size_t n = std::size_t(tree_.levels()[std::size_t(level)].size);
    return slots_[std::size_t(level)][std::size_t(face) * n * n + texel];
  }
  std::span<const SymmetricTexel> values() const { return values_; }

 private:
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};
  const CubeQuadtree& tree_;
  std::vector<std::vector<std::uint32_t>> slots_;  // by level and texel
  std::vector<std::array<CubeSymmetry, kCubeSymmetries>> symmetries_;
  std::vector<SymmetricTexel> values_;
};

// Neighbouring texels of a result, with a cone around their directions.
struct Block {
  std::vector<Texel> texels;
  std::vector<glm::vec3> directions;
  glm::vec3 middle{0};
  float spread = 0;

  SixteenDirections in_face(int face) const {
    const glm::vec3 major = face_direction(face, 0.5f, 0.5f);
    const glm::vec3 s = face_direction(face, 1, 0.5f) - major;
    const glm::vec3 t = face_direction(face, 0.5f, 1) - major;
    SixteenDirections result{};
    for (std::size_t o = 0; o < directions.size(); ++o) {
      result.x[o] = glm::dot(directions[o], s);
      result.y[o] = glm::dot(directions[o], t);
      result.z[o] = glm::dot(directions[o], major);
    }
    return result;
  }
};

// Sixteen weights of a texel, one for each direction of a block.
struct alignas(64) Row {
  float values[kOutputs];
};

std::vector<Block> blocks(int size) {
  const int cells = (size + kBlock - 1) / kBlock;
  std::vector<Block> grid(std::size_t(cells) * cells);
  for (const Texel& t : fundamental_texels(size)) {
    Block& block = grid[std::size_t(t.y / kBlock) * cells + std::size_t(t.x / kBlock)];
    block.texels.push_back(t);
    block.directions.push_back(glm::normalize(texel_direction(4, t.x, t.y, size)));
    block.middle += block.directions.back();
  }
  std::erase_if(grid, [](const Block& b) { return b.texels.empty(); });
  for (Block& block : grid) {
    block.middle = glm::normalize(block.middle);
    for (const glm::vec3& d : block.directions)  // chord → angle; 1 % for the float cosine
      block.spread = std::max(block.spread,
                              2.02f * std::asin(std::min(1.0f, glm::length(d - block.middle) / 2)));
  }
  return grid;
}

// Weights of a choice in the lobes around a block's directions, and their sums.
struct Weights {
  std::vector<Row> rows;
  Row totals;
  std::vector<SeenTexel> seen;

  void set(const CubeQuadtree& tree, const Lobe& lobe, const TexelChoice& choice,
           const Block& block) {
    rows.resize(choice.texels.size());
    totals = {};
    for (const TexelRun& run : choice.runs) {
      const QuadtreeLevel& level = tree.levels()[std::size_t(run.level)];
      seen.clear();
      for (std::size_t i = run.first; i < run.first + run.count; ++i) {
        const std::uint32_t k = choice.texels[i];
        // The finest texels count by their middle, as in a sum over the map.
        seen.push_back({level.x[k], level.y[k], level.z[k], level.deficit[k], level.angle[k],
                        run.level > 0 ? level.angle[k] : 0});
      }
      set_lobe_weights(lobe, block.in_face(run.face), seen, rows[run.first].values, totals.values);
    }
  }
};

// A texel on a plane of symmetry is its own image. Its sums, which differ by the error where the
// choice of texels is lopsided, are averaged, so that a turned map gives the turned result. A lobe
// that meets no texel, because it lies between them, becomes a mirror.
void write(const Block& block, const CubeMap& map, int size, std::span<const SymmetricTexel> sums,
           const float* totals, const std::array<CubeSymmetry, kCubeSymmetries>& symmetries,
           std::vector<glm::vec3>& faces) {
  for (std::size_t o = 0; o < block.texels.size(); ++o) {
    const auto image = [&](int g) {
      return symmetries[std::size_t(g)][4](block.texels[o].x, block.texels[o].y);
    };
    if (!(totals[o] > 0)) {
      for (int g = 0; g < kCubeSymmetries; ++g) {
        const int i = int(image(g)), in_face = i % (size * size);
        faces[std::size_t(i)] =
            map.sample(texel_direction(i / (size * size), in_face % size, in_face / size, size),
                       std::max(std::log2(float(map.size()) / float(size)), 0.0f));
      }
      continue;
    }
    int repeated = 0;
    for (int g = 0; g < kCubeSymmetries; ++g) repeated += image(g) == image(0);
    const float scale = float(repeated) * totals[o];
    for (int g = 0; g < kCubeSymmetries; ++g) {
      const auto& v = sums[o].values;
      faces[std::size_t(image(g))] += glm::vec3(v[0][g], v[1][g], v[2][g]) / scale;
    }
  }
}

// The map at another size; one of its own levels where possible.
CubeMap resized(const CubeMap& map, int size) {
  if (size == map.size()) return map;
  for (int k = 1; k < map.level_count(); ++k) {
    const CubeLevel& level = map.level(k);
    if (level.size() != size || map.size() != size << k) continue;
    std::vector<glm::vec3> faces;
    faces.reserve(6 * std::size_t(size) * size);
    for (int f = 0; f < 6; ++f)
      for (int y = 0; y < size; ++y)
        faces.insert(faces.end(), &level.texel(f, 0, y), &level.texel(f, 0, y) + size);
    return CubeMap(size, faces);
  }
  return resampled(map, size);
}

CubeMap convolve(const CubeQuadtree& tree, SymmetricValues& values, const Lobe& lobe, int size,
                 double error) {
  const LobeTable table(lobe);
  // The mean error of a level falls with the square root of the limit, because a lower limit cuts
  // more texels into smaller, independent parts: on seven real maps nMAE <= 3.2 % √limit on every
  // level.
  const float limit = float(600 * error * error * table.integral);
  const ChoiceLimits limits{limit, 5e-5f * limit};
  const std::vector<Block> all = blocks(size);
  std::vector<TexelChoice> choices(all.size());
  parallel_for(int(all.size()), 1, [&](int begin, int end) {
    for (int i = begin; i < end; ++i)
      choices[std::size_t(i)] = choose_texels(tree, table, all[std::size_t(i)].middle,
                                              all[std::size_t(i)].spread, limits);
  });
  values.gather(choices);

  const auto symmetries = cube_symmetries(size, size, std::ptrdiff_t(size) * size);
  std::vector<glm::vec3> faces(6 * std::size_t(size) * size);
  parallel_for(int(all.size()), 1, [&](int begin, int end) {
    Weights weights;
    std::vector<std::uint32_t> slots;
    std::vector<SymmetricTexel> sums(kOutputs);
    for (int i = begin; i < end; ++i) {
      const Block& block = all[std::size_t(i)];
      const TexelChoice& choice = choices[std::size_t(i)];
      const int outputs = int(block.texels.size());
      weights.set(tree, lobe, choice, block);
      slots.clear();
      for (const TexelRun& run : choice.runs)
        for (std::size_t k = run.first; k < run.first + run.count; ++k)
          slots.push_back(values.slot_of(run.level, run.face, choice.texels[k]));
      std::fill(sums.begin(), sums.end(), SymmetricTexel{});
      if (!slots.empty())
        add_symmetric_sums(values.values(), slots, weights.rows.data()->values, outputs,
                           sums.data());
      write(block, tree.map(), size, sums, weights.totals.values, symmetries, faces);
    }
  });
  return CubeMap(size, faces);
}

}  // namespace

std::vector<CubeMap> prefilter(std::shared_ptr<const CubeMap> map,
                               std::span<const PrefilterLevel> levels,
                               const PrefilterOptions& options) {
  check(map && map->size() > 0, "prefiltering needs a map");
  check(options.error > 0 && options.error < 1, "error must be between 0 and 1, got ",
        options.error);
  const bool ggx = options.model == LobeModel::ggx;
  const auto is_mirror = [&](double parameter) {
    return ggx ? parameter == 0 : std::isinf(parameter);
  };
  int finest = 32;  // wide lobes over few texels
  for (const PrefilterLevel& level : levels) {
    check(level.size >= 1, "size must be at least 1, got ", level.size);
    check(level.parameter >= 0 && (!ggx || level.parameter <= 1),
          ggx ? "alpha must be in [0, 1], got " : "the exponent must be at least 0, got ",
          level.parameter);
    if (is_mirror(level.parameter)) continue;
    // Two texels in half the height of the lobe, or as many as 256² have.
    const double angle = std::sqrt(2 * Lobe{options.model, level.parameter}.half_height());
    finest = std::max(finest, int(std::min(256.0, 3 / angle)));
  }
  const CubeQuadtree tree(map, finest);
  SymmetricValues values(tree);
  std::vector<CubeMap> result;
  for (const PrefilterLevel& level : levels)
    result.push_back(
        !level.wanted ? CubeMap()
        : is_mirror(level.parameter)
            ? resized(*map, level.size)
            : convolve(tree, values, {options.model, level.parameter}, level.size, options.error));
  return result;
}

CubeMap irradiance_cube(const CubeMap& map, int size, int source) {
  check(map.size() > 0, "an irradiance needs a map");
  check(size >= 1 && size <= 256 && source >= 1 && source <= 256,
        "size and source must be from 1 to 256, got ", size, " and ", source);
  CubeMap cube(size);
  cube.base() = irradiance_cube(fold(map, source), size);
  cube.update();
  return cube;
}

std::array<glm::dvec3, 9> project_sh9(const CubeMap& map) {
  check(map.size() > 0, "harmonics need a map");
  return project_sh9(fold(map, kSumSize));
}

std::string_view name(LevelMapping mapping) {
  switch (mapping) {
    case LevelMapping::filament:
      return "filament";
    case LevelMapping::unity:
      return "unity";
    case LevelMapping::cmft:
      return "cmft";
    default:
      return "gltf";
  }
}

LevelMapping level_mapping(std::string_view text) {
  return method_named(text,
                      std::array{LevelMapping::gltf, LevelMapping::filament, LevelMapping::unity,
                                 LevelMapping::cmft},
                      "level mapping");
}

std::vector<double> level_parameters(LevelMapping mapping, int count) {
  check(count >= 1, "there must be at least one level, got ", count);
  std::vector<double> parameters;
  for (int k = 0; k < count; ++k) {
    const double lod = count > 1 ? double(k) / (count - 1) : 0;
    const double roughness = mapping == LevelMapping::gltf ? lod
                             : mapping == LevelMapping::unity
                                 ? (1.7 - std::sqrt(2.89 - 2.8 * lod)) / 1.4
                                 : 1 - std::sqrt(1 - lod);
    parameters.push_back(mapping == LevelMapping::cmft
                             ? 1 + std::exp2(1 + 8 * (1 - double(k) / count))
                             : roughness * roughness);
  }
  return parameters;
}

}  // namespace fastibl
