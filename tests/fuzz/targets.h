// What arbitrary bytes from the bus may do to the stack: nothing. Each target takes bytes as frames, and
// aborts when a property of the stack does not hold. Run by libFuzzer and by the tests; knows neither.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

namespace tendril::fuzz {

struct Target {
  std::string_view name;
  int (*run)(std::span<const std::uint8_t> bytes);  // returns how many frames it made of the bytes
};

/// SdoClient   requests against whatever a server may answer: an end state only for a reason, no value above
/// the
///             capacity, no write outside the buffer.
/// SdoServer   requests in any order: one answer each, known abort codes, values within the buffer.
/// Pdo         any mapping: what decodes encodes to the same bytes, too short ones do not decode.
/// Emcy, Nmt, Heartbeat   what decodes is what CiA 301 allows, and encodes to the same frame.
/// Master      a booted master with three drives under a storm of frames: no torque to a drive that was not
/// seen
///             in operation enabled and never without a request; it can be booted afresh afterwards.
/// Drive       three emulated drives under a storm of frames: no torque without power, nothing sent that a
/// master
///             could not read, and after NMT reset each answers as a new one.
std::span<const Target> Targets();
/// nullptr for an unknown name.
const Target* FindTarget(std::string_view name);

}  // namespace tendril::fuzz
