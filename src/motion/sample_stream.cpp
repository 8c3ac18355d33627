#include "tendril/motion/sample_stream.h"

#include <algorithm>
#include <utility>

namespace tendril::motion {

void SampleStream::Add(TimeNs arrived_ns, const Eigen::VectorXd& value, TimeNs valid_for_ns) {
  // Of two at the same time the later one counts.
  if (!samples_.empty() && samples_.back().at_ns >= arrived_ns) {
    samples_.back() = {samples_.back().at_ns, value, arrived_ns + valid_for_ns};
    return;
  }
  // After a pause the motion continues from its rest at the time of the new sample; from the time of the
  // previous one it would jump.
  if (!samples_.empty() && arrived_ns - samples_.back().at_ns > delay_ns_) {
    samples_.push_back({arrived_ns - delay_ns_, samples_.back().value, samples_.back().until_ns});
  }
  samples_.push_back({arrived_ns, value, arrived_ns + valid_for_ns});
}

SampleStream::Point SampleStream::At(TimeNs now_ns) {
  const TimeNs at_ns = now_ns - delay_ns_;
  while (samples_.size() > 1 && samples_[1].at_ns <= at_ns) samples_.pop_front();
  const Sample& before = samples_.front();
  if (samples_.size() == 1 || at_ns < before.at_ns)
    return {before.value, Eigen::VectorXd::Zero(before.value.size())};
  const Sample& after = samples_[1];
  const double whole_s = ToSeconds(after.at_ns - before.at_ns), done_s = ToSeconds(at_ns - before.at_ns);
  const Eigen::VectorXd rate = (after.value - before.value) / whole_s;
  return {before.value + done_s * rate, rate};
}

bool SampleStream::Expired(TimeNs now_ns) const {
  return !samples_.empty() && now_ns > std::max(samples_.back().until_ns, samples_.back().at_ns + delay_ns_);
}

}  // namespace tendril::motion
