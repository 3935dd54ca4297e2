#include "demo/timings.h"

#include <algorithm>
#include <iomanip>
#include <ostream>

#include "fastibl/plan/plan.h"

namespace fastibl::demo {
namespace {

double quantile(std::vector<double> values, double q) {
  const auto at = values.begin() + std::ptrdiff_t(q * double(values.size() - 1) + 0.5);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

}  // namespace

void Timings::add(const std::map<std::string, double>& seconds) {
  for (const auto& [pass, value] : seconds) seconds_[pass].push_back(value);
}

double Timings::recent_milliseconds() const {
  constexpr std::ptrdiff_t kRecent = 30;
  const auto total = seconds_.find("total");
  if (total == seconds_.end()) return 0;
  const std::vector<double>& all = total->second;
  return 1e3 * quantile({all.end() - std::min(kRecent, std::ssize(all)), all.end()}, 0.5);
}

void Timings::print(std::ostream& out) const {
  const auto total = seconds_.find("total");
  if (total == seconds_.end()) return;
  std::vector<std::string> order;
  for (const PassId id : kPasses) order.emplace_back(name(id));
  order.emplace_back("total");
  out << std::left << std::setw(12) << "pass" << std::right << std::setw(7) << "runs"
      << std::setw(11) << "median ms" << std::setw(9) << "95 % ms" << '\n'
      << std::fixed << std::setprecision(2);
  for (const std::string& pass : order) {
    const auto found = seconds_.find(pass);
    if (found == seconds_.end()) continue;
    out << std::left << std::setw(12) << pass << std::right << std::setw(7) << found->second.size()
        << std::setw(11) << 1e3 * quantile(found->second, 0.5) << std::setw(9)
        << 1e3 * quantile(found->second, 0.95) << '\n';
  }
  double sum = 0;
  for (const double s : total->second) sum += s;
  out << std::setprecision(1) << double(total->second.size()) / std::max(sum, 1e-9)
      << " frames/s of processing\n";
}

}  // namespace fastibl::demo
