// The order of the parts; see the header.
#include "tendril/first_robot/questions.h"

#include "built_in_files.h"
#include "parts.h"
#include "tendril/config/config.h"

namespace tendril::first_robot {

NewRobot Ask(const Dialogue& dialogue,
             const std::function<std::string(const std::string& name)>& robot_file) {
  NewRobot made{.robot = config::ParseRobot(std::string(kRigFile), "rig_60mm.yaml"),
                .daemon = config::ParseDaemon(std::string(kDaemonFile), "tendrild.yaml")};
  made.daemon.black_box.reset();  // its folder needs rights that a first robot has not
  Asker ask(dialogue);
  made.robot.name = ask.Text("name", "my_robot");
  made.daemon.robot_file = robot_file(made.robot.name);
  AskBody(ask, made);
  AskDrives(ask, made);
  AskBus(ask, made);
  return made;
}

}  // namespace tendril::first_robot
