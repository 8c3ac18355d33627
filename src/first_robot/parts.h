// The parts of the interview, in its order; each takes the rig as it is and puts the answers in.
#pragma once

#include "asker.h"

namespace tendril::first_robot {

/// Sections, tendons, masses, stiffness, damping.
void AskBody(Asker& ask, NewRobot& made);
/// Motor, gear, spool, tendon, pulleys; tension limits; load cells and tracker; largest bend.
void AskDrives(Asker& ask, NewRobot& made);
/// Nodes and cycle; and the controller's thresholds, in proportion to the robot.
void AskBus(Asker& ask, NewRobot& made);

}  // namespace tendril::first_robot
