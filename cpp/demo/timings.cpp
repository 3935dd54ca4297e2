#include "demo/timings.h"

#include <algorithm>
#include <iomanip>
#include <ostream>

#include "fastibl/plan/plan.h"

namespace fastibl::demo {
namespace {

constexpr std::ptrdiff_t kRecent = 30;  // frames
constexpr std::size_t kWarming = 10;    // first frames, which build what is kept for later ones

double quantile(std::vector<double> values, double q) {
  const auto at = values.begin() + std::ptrdiff_t(q * double(values.size() - 1) + 0.5);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

}  // namespace

void Timings::Runs::add(double seconds) {
  ++count, sum += seconds;
  last.push_back(seconds);
  if (last.size() > kKept) last.pop_front();
}

void Timings::add(const std::map<std::string, double>& seconds) {
  for (const auto& [pass, value] : seconds) runs_[pass].add(value);
}

void Timings::add(const std::string& part, double seconds) {
  if (std::find(own_.begin(), own_.end(), part) == own_.end()) own_.push_back(part);
  runs_[part].add(seconds);
}

void Timings::count_frame() {
  const Moment now{clock_.seconds(), processor_.seconds()};
  ++frames_;
  if (first_.size() <= kWarming) first_.push_back(now);
  last_.push_back(now);
  if (std::ssize(last_) > kRecent + 1) last_.pop_front();
}

std::vector<std::string> Timings::order() const {
  std::vector<std::string> order;
  const auto add = [&](const std::string& part) {
    if (runs_.contains(part)) order.push_back(part);
  };
  for (const PassId id : kPasses) add(std::string(name(id)));
  add("total");
  for (const std::string& part : own_) add(part);
  return order;
}

double Timings::recent(const std::string& part) const {
  const auto found = runs_.find(part);
  if (found == runs_.end()) return 0;
  const std::deque<double>& all = found->second.last;
  return 1e3 * quantile({all.end() - std::min(kRecent, std::ssize(all)), all.end()}, 0.5);
}

double Timings::frames_per_second() const {
  const std::ptrdiff_t count = std::ssize(last_) - 1;
  if (count < 1) return 0;
  return double(count) / std::max(last_.back().shown - last_.front().shown, 1e-9);
}

void Timings::print(std::ostream& out) const {
  const auto total = runs_.find("total");
  if (total == runs_.end()) return;
  out << std::left << std::setw(12) << "pass" << std::right << std::setw(7) << "runs"
      << std::setw(11) << "median ms" << std::setw(9) << "95 % ms" << '\n'
      << std::fixed << std::setprecision(2);
  for (const std::string& part : order()) {
    const Runs& runs = runs_.at(part);
    const std::vector<double> last(runs.last.begin(), runs.last.end());
    out << std::left << std::setw(12) << part << std::right << std::setw(7) << runs.count
        << std::setw(11) << 1e3 * quantile(last, 0.5) << std::setw(9) << 1e3 * quantile(last, 0.95)
        << '\n';
  }
  out << std::setprecision(1) << double(total->second.count) / std::max(total->second.sum, 1e-9)
      << " frames/s of processing\n";
  const std::int64_t first = std::min(std::int64_t{kWarming}, frames_ / 2), last = frames_ - 1;
  if (frames_ < 2 || last <= first) return;
  const double frames = double(last - first);
  const Moment &begin = first_[std::size_t(first)], &end = last_.back();
  out << frames / std::max(end.shown - begin.shown, 1e-9) << " frames/s in all, "
      << 1e3 * (end.used - begin.used) / frames << " ms of processor time each\n";
}

}  // namespace fastibl::demo
