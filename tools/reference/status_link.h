// Links from other pages to that of the status codes.
#pragma once

#include <string>

#include "tendril/core/status.h"

namespace tendril::reference {

int NumberOf(Status status);
std::string StatusLink(Status status);

}  // namespace tendril::reference
