#include "capstan_cache.h"

#include <algorithm>
#include <map>
#include <mutex>
#include <utility>
#include <vector>

namespace tendril::sim {
namespace {

class CapstanCache {
 public:
  using Table = std::shared_ptr<const model::CapstanTable>;
  Table Get(const TransmissionParameters& t, double most_N, double relative_error) {
    std::vector<double> key{most_N, relative_error, t.low_tension_N};
    for (const auto& p : t.pulleys) {
      key.insert(key.end(), {static_cast<double>(p.law), p.wrap_rad, p.radius_ratio, p.alpha, p.exponent,
                             p.entry_angle_rad});
    }
    {
      const std::lock_guard lock(mutex_);
      const auto found = tables_.find(key);
      if (found != tables_.end()) {
        found->second.used = ++clock_;
        return found->second.table;
      }
    }
    const auto table = std::make_shared<const model::CapstanTable>(t, most_N, relative_error);
    const std::lock_guard lock(mutex_);
    if (tables_.size() >= kMost) {
      tables_.erase(std::min_element(tables_.begin(), tables_.end(), [](const auto& a, const auto& b) {
        return a.second.used < b.second.used;
      }));
    }
    return tables_.insert_or_assign(std::move(key), Entry{table, ++clock_}).first->second.table;
  }

 private:
  static constexpr std::size_t kMost = 256;

  struct Entry {
    Table table;
    long used;
  };
  std::mutex mutex_;
  std::map<std::vector<double>, Entry> tables_;
  long clock_ = 0;
};

}  // namespace

std::shared_ptr<const model::CapstanTable> CachedCapstanTable(const TransmissionParameters& transmission,
                                                              double most_N, double relative_error) {
  static CapstanCache all;
  return all.Get(transmission, most_N, relative_error);
}

}  // namespace tendril::sim
