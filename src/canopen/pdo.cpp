// Packing and unpacking of mapped values.
// Knows objects by width only.
#include "tendril/canopen/pdo.h"

#include "tendril/canopen/wire.h"

namespace tendril::canopen {

int EncodePdo(std::span<const MappingEntry> entries, std::span<const std::int64_t> values,
              std::span<std::uint8_t, 8> data) noexcept {
  std::size_t at = 0;
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const std::size_t bytes = entries[i].bits / 8u;
    if (at + bytes > data.size()) break;
    PutLe(data.subspan(at), static_cast<std::uint64_t>(values[i]), static_cast<int>(bytes));
    at += bytes;
  }
  return static_cast<int>(at);
}

bool DecodePdo(std::span<const MappingEntry> entries, std::span<const std::uint8_t> data,
               std::span<std::int64_t> values) noexcept {
  std::size_t at = 0;
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const std::size_t bytes = entries[i].bits / 8u;
    if (at + bytes > data.size()) return false;
    const std::uint64_t raw = GetLe(data.subspan(at), static_cast<int>(bytes));
    values[i] = entries[i].is_signed ? SignExtend(raw, entries[i].bits) : static_cast<std::int64_t>(raw);
    at += bytes;
  }
  return true;
}

}  // namespace tendril::canopen
