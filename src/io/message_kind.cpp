#include "message_kind.h"

#include <algorithm>
#include <array>
#include <cctype>

#include "tendril/io/log_messages.h"
#include "tendril/io/wire.h"
#include "tendril_lcm/fault_t.hpp"

namespace tendril::io {
namespace {

template <class Message>
MessageKind Kind() {
  return {Message::getTypeName(), Message::getHash(), [](std::span<const std::uint8_t> data) noexcept {
            static thread_local Message message;  // reused, so that decoding does not allocate anew
            return Decode(data.data(), static_cast<int>(data.size()), message);
          }};
}

template <class... Messages>
std::array<MessageKind, sizeof...(Messages)> Kinds() {
  return {Kind<Messages>()...};
}

const auto& AllKinds() {
  using namespace tendril_lcm;
  static const auto kinds =
      Kinds<cycle_t, state_t, command_bending_t, command_mode_t, command_tension_t, command_tip_t, event_t,
            fault_t, run_t, snapshot_t, statistics_t, tracker_t>();
  return kinds;
}

}  // namespace

const MessageKind* KindOf(std::span<const std::uint8_t> data) noexcept {
  std::int64_t fingerprint = 0;
  if (__int64_t_decode_array(data.data(), 0, static_cast<int>(data.size()), &fingerprint, 1) < 0)
    return nullptr;
  const auto found = std::find_if(AllKinds().begin(), AllKinds().end(),
                                  [&](const MessageKind& kind) { return kind.fingerprint == fingerprint; });
  return found == AllKinds().end() ? nullptr : &*found;
}

std::string_view TypeOfMessage(std::span<const std::uint8_t> data) noexcept {
  const MessageKind* kind = KindOf(data);
  return kind != nullptr && kind->decodes(data) ? kind->name : std::string_view();
}

bool IsChannelOfTendril(std::string_view channel) {
  return std::any_of(AllKinds().begin(), AllKinds().end(), [&](const MessageKind& kind) {
    const std::string_view name = kind.name.substr(0, kind.name.size() - 2);  // without its _t
    if (channel.size() <= name.size()) return false;
    const std::string_view ending = channel.substr(channel.size() - name.size() - 1);
    return ending.front() == '_' && std::equal(name.begin(), name.end(), ending.begin() + 1,
                                               [](char a, char b) { return std::toupper(a) == b; });
  });
}

}  // namespace tendril::io
