#include "fastibl/lighting/fit_lobes.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "fastibl/core/simd.h"
#include "fastibl/core/solve.h"
#include "fastibl/lighting/irradiance_sums.h"

namespace fastibl {
namespace {

constexpr int kNodes = 12,
              kCandidates = 8;  // cube sizes: for judging the fit, for starting lobes
constexpr int kUsual = 8;       // at most this many lobes are found unasked
constexpr int kColdSteps = 2, kLastSteps = 4, kWarmSteps = 2;
constexpr int kWeighings = 2;
constexpr float kWorse = 1.5f;  // the share that is left, relative to the frame before's, at which
constexpr float kWorseAtLeast = 0.05f;  // the lobes are searched anew
constexpr double kTwoColours = 1.05;  // two colours if one leaves more than this times what many do

// Half the sphere: an octant's nodes and their images in x, y and z.
struct Nodes {
  int count = 0, stride = 0;         // rows are padded with weight 0
  std::vector<float> x, y, z, root;  // root of the weight; the weights sum to 1
};

Nodes make_nodes(int size) {
  const OctantGrid& grid = octant_grid(size);
  Nodes n;
  n.count = int(grid.x.size()) * 4;
  n.stride = (n.count + 15) / 16 * 16;
  for (auto* row : {&n.x, &n.y, &n.z, &n.root}) row->resize(std::size_t(n.stride));
  for (std::size_t i = 0; i < grid.x.size(); ++i)
    for (std::size_t image = 0; image < 4; ++image) {
      const std::size_t k = 4 * i + image;
      n.x[k] = image == 1 ? -grid.x[i] : grid.x[i];
      n.y[k] = image == 2 ? -grid.y[i] : grid.y[i];
      n.z[k] = image == 3 ? -grid.z[i] : grid.z[i];
      n.root[k] = float(std::sqrt(double(grid.solid_angle[i]) / (2 * std::numbers::pi)));
    }
  return n;
}

const Nodes& nodes() {
  static const auto* made = new Nodes(make_nodes(kNodes));
  return *made;
}

// A lobe of axis v, a = |v|, less its nine coefficients, is even in c = n·v:
// ½|c| − (3/32) a − (15/32) c²/a. Its derivative by v: (½ sign c − (15/16) c/a) n +
// ((15/32) c²/a³ − (3/32)/a) v. Rows are multiplied by the root of the weights.
FASTIBL_CLONES
void fill_rows(const float* x, const float* y, const float* z, const float* root, int count,
               const float* v, float* __restrict value, float* __restrict dx, float* __restrict dy,
               float* __restrict dz) {
  const float vx = v[0], vy = v[1], vz = v[2];
  const float a2 = vx * vx + vy * vy + vz * vz, a = __builtin_sqrtf(a2), inverse = 1 / a;
  for (int i = 0; i < count; ++i) {
    const float c = x[i] * vx + y[i] * vy + z[i] * vz;
    const float sign = c < 0 ? -0.5f : 0.5f, square = 0.46875f * c * c * inverse;
    value[i] = root[i] * (sign * c - 0.09375f * a - square);
    const float along = root[i] * (sign - 0.9375f * c * inverse);
    const float shrink = root[i] * (square * inverse * inverse - 0.09375f * inverse);
    dx[i] = along * x[i] + shrink * vx;
    dy[i] = along * y[i] + shrink * vy;
    dz[i] = along * z[i] + shrink * vz;
  }
}

// Products of a row with `rows` rows of `count` (a multiple of 16) floats.
FASTIBL_CLONES
void multiply(const float* row, const float* others, int rows, int count, double* products) {
  for (int r = 0; r < rows; ++r) {
    const float* other = others + std::ptrdiff_t(r) * count;
    float lanes[16] = {};
    for (int i = 0; i < count; i += 16)
      for (int k = 0; k < 16; ++k) lanes[k] += row[i + k] * other[i + k];
    float sum = 0;
    for (int k = 0; k < 16; ++k) sum += lanes[k];
    products[r] = double(sum);
  }
}

double product(const std::vector<float>& a, const std::vector<float>& b) {
  double p = 0;
  multiply(a.data(), b.data(), 1, int(a.size()), &p);
  return p;
}

// Values of unit lobes at the candidates, as rows over the nodes times the root of their weights,
// and the rows' squared norms.
struct Candidates {
  std::vector<glm::vec3> axes;
  std::vector<float> rows;
  std::vector<double> norms;

  Candidates() {
    const Nodes& n = nodes();
    const Nodes from = make_nodes(kCandidates);
    std::vector<float> unused(std::size_t(n.stride) * 3);
    rows.resize(std::size_t(from.count) * n.stride);
    for (int k = 0; k < from.count; ++k) {
      const std::size_t i = std::size_t(k);
      axes.emplace_back(from.x[i], from.y[i], from.z[i]);
      float* row = &rows[i * n.stride];
      fill_rows(n.x.data(), n.y.data(), n.z.data(), n.root.data(), n.stride, &axes.back().x, row,
                &unused[0], &unused[std::size_t(n.stride)], &unused[std::size_t(2 * n.stride)]);
      double norm = 0;
      multiply(row, row, 1, n.stride, &norm);
      norms.push_back(norm);
    }
  }
};

const Candidates& candidates() {
  static const auto* made = new Candidates;
  return *made;
}

// Levenberg–Marquardt on the axes, for one channel. The sign of an amplitude needs no care: its
// axis turns round, and lobes are even.
class AxisFit {
 public:
  explicit AxisFit(std::vector<float> target)
      : root_(nodes().root), target_(std::move(target)), left_(target_) {
    cost_ = product(left_, left_);
  }

  const std::vector<glm::vec3>& axes() const { return axes_; }
  double cost() const { return cost_; }

  void start(std::vector<glm::vec3> axes) {
    axes_ = std::move(axes);
    evaluate();
  }
  // Adds the lobe that removes most of what is left; false if none removes any.
  bool add() {
    const Candidates& c = candidates();
    const int stride = nodes().stride;
    std::vector<double> with(c.axes.size());
    multiply(left_.data(), c.rows.data(), int(with.size()), stride, with.data());
    double best = 0;
    std::size_t chosen = 0;
    for (std::size_t k = 0; k < with.size(); ++k)
      if (with[k] > 0 && with[k] * with[k] > best * c.norms[k])
        best = with[k] * with[k] / c.norms[k], chosen = k;
    if (!(best > 1e-12 * product(target_, target_))) return false;
    axes_.push_back(c.axes[chosen] * float(with[chosen] / c.norms[chosen]));
    evaluate();
    return true;
  }
  void refine(int steps) {
    double damping = 1e-3;
    for (int step = 0; step < steps && !axes_.empty(); ++step) {
      const std::size_t n = 3 * axes_.size();
      std::vector<double> matrix(n * n), gradient(n);
      multiply(left_.data(), derivatives_.data(), int(n), nodes().stride, gradient.data());
      for (std::size_t i = 0; i < n; ++i)
        multiply(&derivatives_[i * nodes().stride], derivatives_.data(), int(i) + 1, nodes().stride,
                 &matrix[i * n]);
      double trace = 0;
      for (std::size_t i = 0; i < n; ++i) trace += matrix[i * n + i];
      const std::vector<glm::vec3> before = axes_;
      const double cost = cost_;
      bool better = false;
      for (int trial = 0; trial < 4 && !better; ++trial) {
        std::vector<double> damped = matrix, move = gradient;
        for (std::size_t i = 0; i < n; ++i) damped[i * n + i] += damping * trace / double(n);
        if (solve_in_place(damped, move)) {
          for (std::size_t k = 0; k < axes_.size(); ++k)
            axes_[k] = before[k] + glm::vec3(move[3 * k], move[3 * k + 1], move[3 * k + 2]);
          evaluate();
          better = cost_ < cost;
        }
        damping *= better ? 0.3 : 4;
      }
      if (!better) {
        axes_ = before;
        evaluate();
        return;
      }
    }
  }
  // Moves from least squares towards least mean error, which is what the eye sees and what the
  // benchmarks state: nodes with a larger error weigh less. Scales `rows` in the same way.
  void weigh_by_error(std::array<std::vector<float>, 3>& rows) {
    constexpr float kSoft = 0.25f;  // of the mean error, where weights stop growing
    const std::size_t count = std::size_t(nodes().count);
    const auto error = [&](std::size_t i) { return std::abs(left_[i]) / root_[i]; };
    double mean = 0;
    for (std::size_t i = 0; i < count; ++i)
      mean += double(nodes().root[i]) * double(nodes().root[i]) * double(error(i));
    if (!(mean > 0)) return;
    const float scale = float(mean);
    for (std::size_t i = 0; i < count; ++i) {
      const float factor = std::sqrt(scale / (error(i) + kSoft * scale));
      const float change = factor * nodes().root[i] / root_[i];
      root_[i] *= change;
      target_[i] *= change;
      for (auto& row : rows) row[i] *= change;
    }
    evaluate();
  }
  // Removes lobes that have next to no light.
  void drop_dark() {
    float longest = 0;
    for (const glm::vec3& a : axes_) longest = std::max(longest, glm::length(a));
    const auto dark = [&](const glm::vec3& a) { return !(glm::length(a) > 1e-4f * longest); };
    const std::size_t before = axes_.size();
    axes_.erase(std::remove_if(axes_.begin(), axes_.end(), dark), axes_.end());
    if (axes_.size() != before) evaluate();
  }
  // Rows over the nodes of the lobes at unit length.
  std::vector<std::vector<float>> unit_rows() const {
    std::vector<std::vector<float>> rows(axes_.size());
    for (std::size_t k = 0; k < axes_.size(); ++k) {
      rows[k].assign(values_.begin() + std::ptrdiff_t(k) * nodes().stride,
                     values_.begin() + std::ptrdiff_t(k + 1) * nodes().stride);
      const float scale = 1 / glm::length(axes_[k]);
      for (float& value : rows[k]) value *= scale;
    }
    return rows;
  }

 private:
  void evaluate() {
    const Nodes& n = nodes();
    const std::size_t stride = std::size_t(n.stride);
    values_.resize(axes_.size() * stride);
    derivatives_.resize(3 * axes_.size() * stride);
    left_ = target_;
    for (std::size_t k = 0; k < axes_.size(); ++k) {
      float* d = &derivatives_[3 * k * stride];
      float* value = &values_[k * stride];
      fill_rows(n.x.data(), n.y.data(), n.z.data(), root_.data(), n.stride, &axes_[k].x, value, d,
                d + stride, d + 2 * stride);
      for (std::size_t i = 0; i < stride; ++i) left_[i] -= value[i];
    }
    cost_ = product(left_, left_);
  }

  std::vector<glm::vec3> axes_;
  std::vector<float> root_, target_, left_, values_, derivatives_;
  double cost_ = 0;
};

// What nine coefficients leave of the irradiance, as RGB rows over the nodes times the root of the
// weights.
using Rows = std::array<std::vector<float>, 3>;

Rows rows_left(const FoldedMap& map, const std::array<glm::vec3, 9>& c) {
  const Nodes& n = nodes();
  const OctantGrid& grid = octant_grid(kNodes);
  const std::vector<std::array<glm::vec3, 4>> even = even_irradiance(map, grid);
  Rows rows;
  for (auto& row : rows) row.resize(std::size_t(n.stride));
  for (std::size_t i = 0; i < std::size_t(n.count); ++i) {
    const float x = n.x[i], y = n.y[i], z = n.z[i];
    const glm::vec3 nine = c[0] + c[4] * (x * y) + c[5] * (y * z) + c[6] * (3 * z * z - 1) +
                           c[7] * (x * z) + c[8] * (x * x - y * y);
    const glm::vec3 left = n.root[i] * (even[i / 4][i % 4] - nine);
    for (int k = 0; k < 3; ++k) rows[std::size_t(k)][i] = left[k];
  }
  return rows;
}

// The main colour of the rows: the first eigenvector of the 3 × 3 moments, by squaring them.
glm::vec3 main_colour(const Rows& rows) {
  glm::dmat3 m;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) m[i][j] = product(rows[std::size_t(i)], rows[std::size_t(j)]);
  for (int k = 0; k < 20; ++k) {
    const double trace = m[0][0] + m[1][1] + m[2][2];
    if (!(trace > 0)) return glm::vec3(0.57735f);
    m = (m / trace) * (m / trace);
  }
  glm::dvec3 colour = m[0];
  for (int k = 1; k < 3; ++k)
    if (glm::dot(m[k], m[k]) > glm::dot(colour, colour)) colour = m[k];
  if (colour.x + colour.y + colour.z < 0) colour = -colour;
  return glm::vec3(glm::normalize(colour));
}

// Normal equations for the amplitudes of unit lobes.
struct Amplitudes {
  std::size_t count;
  std::vector<double> gram;      // count × count
  std::vector<glm::dvec3> with;  // products with what is to be fitted
  double norm;                   // of what is to be fitted

  Amplitudes(const std::vector<std::vector<float>>& lobes, const Rows& rows)
      : count(lobes.size()), gram(count * count), with(count), norm(0) {
    for (std::size_t i = 0; i < count; ++i) {
      for (std::size_t j = 0; j <= i; ++j)
        gram[i * count + j] = gram[j * count + i] = product(lobes[i], lobes[j]);
      for (int c = 0; c < 3; ++c) with[i][c] = product(lobes[i], rows[std::size_t(c)]);
    }
    for (const auto& row : rows) norm += product(row, row);
  }
  double left(const std::vector<glm::dvec3>& a) const {
    double cost = norm;
    for (std::size_t i = 0; i < count; ++i) {
      cost -= 2 * glm::dot(a[i], with[i]);
      for (std::size_t j = 0; j < count; ++j) cost += gram[i * count + j] * glm::dot(a[i], a[j]);
    }
    return std::max(cost, 0.0);
  }
};

constexpr int kSweeps = 60;  // of coordinate descent, with amplitudes of at least 0

// Gives each lobe its own colour.
std::vector<glm::dvec3> free_colours(const Amplitudes& m) {
  std::vector<glm::dvec3> a(m.count, glm::dvec3(0));
  for (int sweep = 0; sweep < kSweeps; ++sweep)
    for (std::size_t i = 0; i < m.count; ++i) {
      glm::dvec3 rest = m.with[i];
      for (std::size_t j = 0; j < m.count; ++j)
        if (j != i) rest -= m.gram[i * m.count + j] * a[j];
      a[i] = glm::max(rest / m.gram[i * m.count + i], glm::dvec3(0));
    }
  return a;
}

struct Coloured {
  std::vector<int> group;  // of each lobe
  std::vector<double> amplitude;
  std::array<glm::dvec3, 2> colours{};
  std::vector<glm::dvec3> all() const {
    std::vector<glm::dvec3> a;
    for (std::size_t k = 0; k < group.size(); ++k)
      a.push_back(amplitude[k] * colours[std::size_t(group[k])]);
    return a;
  }
};

// Fits amplitudes and colours in turn, from a start.
void improve(Coloured& c, const Amplitudes& m) {
  constexpr int kTurns = 8;
  for (int turn = 0; turn < kTurns; ++turn) {
    for (int sweep = 0; sweep < kSweeps / 4; ++sweep)
      for (std::size_t i = 0; i < m.count; ++i) {
        const glm::dvec3 colour = c.colours[std::size_t(c.group[i])];
        double rest = glm::dot(m.with[i], colour);
        for (std::size_t j = 0; j < m.count; ++j)
          if (j != i)
            rest -= m.gram[i * m.count + j] * c.amplitude[j] *
                    glm::dot(colour, c.colours[std::size_t(c.group[j])]);
        const double norm = m.gram[i * m.count + i] * glm::dot(colour, colour);
        c.amplitude[i] = norm > 0 ? std::max(rest / norm, 0.0) : 0;
      }
    for (int g = 0; g < 2; ++g) {
      glm::dvec3 rest(0);
      double norm = 0;
      for (std::size_t i = 0; i < m.count; ++i) {
        if (c.group[i] != g) continue;
        rest += c.amplitude[i] * m.with[i];
        for (std::size_t j = 0; j < m.count; ++j) {
          const double p = c.amplitude[i] * c.amplitude[j] * m.gram[i * m.count + j];
          if (c.group[j] == g)
            norm += p;
          else
            rest -= p * c.colours[std::size_t(1 - g)];
        }
      }
      if (norm > 0) c.colours[std::size_t(g)] = glm::max(rest / norm, glm::dvec3(0));
    }
  }
}

Coloured one_colour(const Amplitudes& m, glm::dvec3 colour) {
  Coloured c{
      std::vector<int>(m.count, 0), std::vector<double>(m.count, 0), {colour, glm::dvec3(0)}};
  improve(c, m);
  return c;
}

// Groups the lobes by their side of the mean colour, along the axis on which they differ most.
Coloured two_colours(const Amplitudes& m, const std::vector<glm::dvec3>& each) {
  glm::dvec3 mean(0);
  for (const glm::dvec3& a : each) mean += a;
  mean /= std::max(mean.x + mean.y + mean.z, 1e-300);
  const auto chroma = [&](const glm::dvec3& a) { return a - (a.x + a.y + a.z) * mean; };
  glm::dvec3 axis(0);
  double widest = 0;
  for (const glm::dvec3& a : each)
    if (const double d = glm::dot(chroma(a), chroma(a)); d > widest) widest = d, axis = chroma(a);
  Coloured c{std::vector<int>(m.count, 0), std::vector<double>(m.count, 0), {}};
  for (std::size_t k = 0; k < m.count; ++k) {
    c.group[k] = glm::dot(chroma(each[k]), axis) > 0 ? 1 : 0;
    c.amplitude[k] = each[k].x + each[k].y + each[k].z;
    c.colours[std::size_t(c.group[k])] += each[k];
  }
  for (glm::dvec3& colour : c.colours) colour /= std::max(colour.x + colour.y + colour.z, 1e-300);
  improve(c, m);
  return c;
}

Lobes coloured(const AxisFit& fit, const Rows& rows, glm::vec3 colour, bool keep_two) {
  const Amplitudes m(fit.unit_rows(), rows);
  const std::vector<glm::dvec3> each = free_colours(m);
  Coloured best = one_colour(m, glm::dvec3(colour));
  if (m.count > 1 && (keep_two || m.left(best.all()) > kTwoColours * kTwoColours * m.left(each))) {
    Coloured two = two_colours(m, each);
    if (m.left(two.all()) < m.left(best.all())) best = std::move(two);
  }
  Lobes lobes;
  std::size_t at = 0;
  for (int g = 0; g < 2; ++g)
    for (std::size_t k = 0; k < m.count; ++k)
      if (best.group[k] == g && best.amplitude[k] > 0) {
        lobes.axes[at++] = glm::normalize(fit.axes()[k]) * float(best.amplitude[k]);
        ++lobes.counts[std::size_t(g)];
      }
  for (std::size_t g = 0; g < 2; ++g) lobes.colours[g] = glm::vec3(best.colours[g]);
  lobes.left = m.norm > 0 ? float(std::sqrt(m.left(best.all()) / m.norm)) : 0;
  return lobes;
}

// For light divided by `scale`.
std::vector<glm::vec3> previous_axes(const Lobes& lobes, glm::vec3 colour, float scale) {
  std::vector<glm::vec3> axes;
  for (int k = 0; k < lobes.count(); ++k) {
    const float part = glm::dot(lobes.colours[k < lobes.counts[0] ? 0 : 1], colour);
    if (part > 0) axes.push_back(part / scale * lobes.axes[std::size_t(k)]);
  }
  return axes;
}

}  // namespace

Lobes fit_lobes(const FoldedMap& map, const std::array<glm::vec3, 9>& polynomial,
                const LobesOptions& options) {
  Rows rows = rows_left(map, polynomial);
  double mean = (polynomial[0].x + polynomial[0].y + polynomial[0].z) / 3.0;
  // Scales the light to a mean of about 1: squares of the dimmest maps' light underflow. A power of
  // two rounds nothing.
  const float scale = mean > 0 ? std::ldexp(1.0f, std::ilogb(mean)) : 1.0f;
  mean /= scale;
  for (auto& row : rows)
    for (float& value : row) value /= scale;
  double norm = 0;
  for (const auto& row : rows) norm += product(row, row);
  const int most = options.count < 0 ? kUsual : std::min(options.count, kMostLobes);
  // RMS over RGB divided by the mean: below the limit there is nothing but rounding.
  const auto rms = [&](double square) { return std::sqrt(square / 3) / std::max(mean, 1e-300); };
  if (most == 0 || !(rms(norm) > 1e-5)) return {};
  const double enough = options.count < 0 ? double(options.error) : 0;

  const glm::vec3 colour = main_colour(rows);
  std::vector<float> target(rows[0].size());
  for (std::size_t i = 0; i < target.size(); ++i)
    target[i] = colour.x * rows[0][i] + colour.y * rows[1][i] + colour.z * rows[2][i];
  AxisFit fit(target);
  const auto finish = [&](bool keep_two) {
    Rows weighed = rows;
    for (int k = 0; k < kWeighings; ++k) fit.weigh_by_error(weighed), fit.refine(kWarmSteps);
    fit.drop_dark();
    Lobes lobes = coloured(fit, weighed, colour, keep_two);
    for (glm::vec3& c : lobes.colours) c *= scale;
    return lobes;
  };
  const auto search = [&](int steps) {
    while (int(fit.axes().size()) < most && rms(fit.cost()) > enough && fit.add())
      fit.refine(steps);
  };

  const Lobes* previous = options.previous;
  if (previous && previous->count() > 0 && previous->count() <= most) {
    fit.start(previous_axes(*previous, colour, scale));
    fit.refine(kWarmSteps);
    fit.drop_dark();
    if (options.count >= 0 || rms(fit.cost()) > 1.25 * enough) search(kWarmSteps);
    Lobes lobes = finish(previous->counts[1] > 0);
    if (lobes.left <= std::max(kWorse * previous->left, kWorseAtLeast)) return lobes;
    fit = AxisFit(target);
  }
  fit.start({});
  search(kColdSteps);
  fit.refine(kLastSteps);
  return finish(false);
}

std::array<glm::vec3, 9> lobe_polynomial(const Lobes& lobes) {
  // max(c, 0) = ¼ + c/2 + 5/32 (3c² − 1) + …; times the axis' length.
  std::array<glm::vec3, 9> sum{};
  for (int k = 0; k < lobes.count(); ++k) {
    const glm::vec3 v = lobes.axes[std::size_t(k)];
    const glm::vec3 colour = lobes.colours[k < lobes.counts[0] ? 0 : 1];
    const float a = glm::length(v), s = 0.46875f / a;
    const float c[9] = {a / 4,
                        v.y / 2,
                        v.z / 2,
                        v.x / 2,
                        2 * s * v.x * v.y,
                        2 * s * v.y * v.z,
                        s * (v.z * v.z - (v.x * v.x + v.y * v.y) / 2) / 3,
                        2 * s * v.x * v.z,
                        s * (v.x * v.x - v.y * v.y) / 2};
    for (std::size_t i = 0; i < 9; ++i) sum[i] += c[i] * colour;
  }
  return sum;
}

}  // namespace fastibl
