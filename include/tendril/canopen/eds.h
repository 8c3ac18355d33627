// Electronic data sheets (CiA 306): what a maker's file says of a drive's objects. Knows no drive and no bus.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "tendril/canopen/object_table.h"

namespace tendril::canopen {

struct Eds {
  std::string file;  // as it was named, for messages
  std::string vendor_name, product_name;
  std::optional<std::uint32_t> vendor, product;  // [DeviceInfo]; 0 there states nothing
  ObjectTable objects;
};

/// Throws std::invalid_argument, one line "file:line: what is wrong; accepted: ...; remedy", for a line that
/// is none of an EDS, a value that is no number or not of its object's type, a listed object without a
/// section, a section, key or object that is there twice, and a file that lists no objects. Sections and keys
/// that CiA 306 does not know are makers' own and are not read; of DCF files neither are ParameterValue and
/// NodeID.
Eds ParseEds(const std::string& text, const std::string& name_for_errors);
/// The same; throws std::invalid_argument, one line, also when `path` is no ordinary file of at most 8 MiB or
/// cannot be read.
Eds ReadEds(const std::string& path);

}  // namespace tendril::canopen
