#include "demo/timings.h"

#include <algorithm>
#include <iomanip>
#include <ostream>

#include "fastibl/plan/plan.h"

namespace fastibl::demo {
namespace {

constexpr std::ptrdiff_t kRecent = 30;  // frames

double quantile(std::vector<double> values, double q) {
  const auto at = values.begin() + std::ptrdiff_t(q * double(values.size() - 1) + 0.5);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

}  // namespace

void Timings::add(const std::map<std::string, double>& seconds) {
  for (const auto& [pass, value] : seconds) seconds_[pass].push_back(value);
}

void Timings::add(const std::string& part, double seconds) {
  if (std::find(own_.begin(), own_.end(), part) == own_.end()) own_.push_back(part);
  seconds_[part].push_back(seconds);
}

void Timings::count_frame() {
  shown_.push_back(clock_.seconds()), used_.push_back(processor_.seconds());
}

std::vector<std::string> Timings::order() const {
  std::vector<std::string> order;
  const auto add = [&](const std::string& part) {
    if (seconds_.contains(part)) order.push_back(part);
  };
  for (const PassId id : kPasses) add(std::string(name(id)));
  add("total");
  for (const std::string& part : own_) add(part);
  return order;
}

double Timings::recent(const std::string& part) const {
  const auto found = seconds_.find(part);
  if (found == seconds_.end()) return 0;
  const std::vector<double>& all = found->second;
  return 1e3 * quantile({all.end() - std::min(kRecent, std::ssize(all)), all.end()}, 0.5);
}

double Timings::frames_per_second() const {
  const std::ptrdiff_t count = std::min(kRecent, std::ssize(shown_) - 1);
  if (count < 1) return 0;
  return double(count) / std::max(shown_.back() - *(shown_.end() - 1 - count), 1e-9);
}

void Timings::print(std::ostream& out) const {
  const auto total = seconds_.find("total");
  if (total == seconds_.end()) return;
  out << std::left << std::setw(12) << "pass" << std::right << std::setw(7) << "runs"
      << std::setw(11) << "median ms" << std::setw(9) << "95 % ms" << '\n'
      << std::fixed << std::setprecision(2);
  for (const std::string& part : order()) {
    const std::vector<double>& all = seconds_.at(part);
    out << std::left << std::setw(12) << part << std::right << std::setw(7) << all.size()
        << std::setw(11) << 1e3 * quantile(all, 0.5) << std::setw(9) << 1e3 * quantile(all, 0.95)
        << '\n';
  }
  double sum = 0;
  for (const double s : total->second) sum += s;
  out << std::setprecision(1) << double(total->second.size()) / std::max(sum, 1e-9)
      << " frames/s of processing\n";
  // The first frames are left out, because they build what is kept for later ones.
  const std::size_t first = std::min<std::size_t>(10, shown_.size() / 2), last = shown_.size() - 1;
  if (shown_.size() < 2 || last <= first) return;
  const double frames = double(last - first);
  out << frames / std::max(shown_[last] - shown_[first], 1e-9) << " frames/s in all, "
      << 1e3 * (used_[last] - used_[first]) / frames << " ms of processor time each\n";
}

}  // namespace fastibl::demo
