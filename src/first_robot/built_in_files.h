// The shipped rig and its daemon, built into the programs: what nobody is asked for is as there.
#pragma once

#include <string_view>

namespace tendril::first_robot {

extern const std::string_view kRigFile;     // config/robots/rig_60mm.yaml
extern const std::string_view kDaemonFile;  // config/tendrild.yaml

}  // namespace tendril::first_robot
