#include "tendril/io/log_messages.h"

#include <map>

#include "cycle_check.h"
#include "event_reader.h"
#include "message_kind.h"

namespace tendril::io {

struct LogMessages::State {
  explicit State(const std::string& path) : reader(path) {}

  /// Empty, or why no Tendril wrote it.
  std::string Trouble(const MessageKind& kind) {
    if (kind.name == tendril_lcm::cycle_t::getTypeName()) {
      const auto size = static_cast<int>(reader.data().size());
      if (Decode(reader.data().data(), size, cycle))
        return checks[reader.channel()].Possible(cycle) ? "" : "holds numbers that no controller writes";
    } else if (kind.decodes(reader.data())) {
      return "";
    }
    return "is no whole " + std::string(kind.name);
  }

  EventReader reader;
  LogMessage message;
  std::map<std::string, CycleCheck> checks;  // one a daemon
  tendril_lcm::cycle_t cycle{};
};

LogMessages::LogMessages(const std::string& path) : state_(std::make_unique<State>(path)) {}
LogMessages::~LogMessages() = default;

bool LogMessages::Next() {
  State& s = *state_;
  while (s.reader.Next()) {
    const MessageKind* kind = KindOf(s.reader.data());
    if (kind != nullptr) {
      if (const std::string trouble = s.Trouble(*kind); !trouble.empty()) {
        s.reader.Refuse("on " + s.reader.channel() + " " + trouble);
        continue;
      }
    }
    s.message = {s.reader.channel(), s.reader.stamp_us(), s.reader.data(),
                 kind == nullptr ? std::string_view() : kind->name};
    return true;
  }
  return false;
}

const LogMessage& LogMessages::message() const { return state_->message; }
std::uint64_t LogMessages::size() const { return state_->reader.size(); }
std::uint64_t LogMessages::position() const { return state_->reader.offset(); }
std::string LogMessages::Damage() const { return state_->reader.Damage(); }

}  // namespace tendril::io
