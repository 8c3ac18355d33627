// The format of measured runs, from the tables that the reader works by; its example is written by the
// writer.
#include "tendril/gap/data_set.h"

#include <fmt/format.h>
#include <unistd.h>

#include "markdown.h"
#include "reference.h"
#include "tendril/config/config.h"
#include "tendril/config/whole_file.h"

namespace tendril::reference {
namespace {

namespace fs = std::filesystem;

gap::Run ExampleRun(const char* name, const char* repeat_of, int tendons) {
  gap::Run run;
  run.name = name;
  run.family = "circle";
  run.repeat_of = repeat_of;
  run.time_s = Eigen::VectorXd::LinSpaced(2, 0, 0.001);
  for (Eigen::MatrixXd* m :
       {&run.torque_target_Nm, &run.torque_actual_Nm, &run.motor_position_rad, &run.tension_N})
    m->setZero(2, tendons);
  run.tip_m = Eigen::RowVector3d(0, 0, 0.06).replicate(2, 1);
  run.tip_quaternion = Eigen::RowVector4d(1, 0, 0, 0).replicate(2, 1);
  return run;
}

/// runs.yaml and the first lines of a table, as WriteDataSet makes them.
std::string Example(const fs::path& source) {
  gap::DataSet set;
  set.name = "example";
  set.robot = config::LoadRobot((source / "config/robots/rig_60mm.yaml").string());
  const int tendons = set.robot.body.tendons();
  set.runs = {ExampleRun("circle_1", "", tendons), ExampleRun("circle_2", "circle_1", tendons)};
  const fs::path folder = fs::temp_directory_path() / fmt::format("tendril-reference-{}", getpid());
  gap::WriteDataSet(set, folder);
  const std::string list = config::ReadWhole(folder / "runs.yaml"),
                    table = config::ReadWhole(folder / "circle_1.csv");
  fs::remove_all(folder);
  return fmt::format("```yaml\n{}```\n\n```text\n{}```\n\n", list, table);
}

}  // namespace

Page DataSetPage(const fs::path& source) {
  std::string text =
      Head("Data set",
           "Measured runs for `tendril gap`: a folder with `robot.yaml` (the nominal robot file), "
           "`runs.yaml` and one CSV or LCM log a run. `tendril gap import` makes one of other tables.",
           {"src/gap/run_table.cpp", "src/gap/runs_file.cpp"});
  text += Heading(2, "Columns", "columns") +
          "One row a sample, columns in any order; j counts tendons from 1, k sections. An empty cell means "
          "no new value. "
          "Further columns are ignored with a note.\n\n";
  Table columns({"Column", "Meaning"});
  for (const gap::ColumnText& column : gap::RunColumns()) {
    columns.Row({Target(column.name, column.name),
                 Prose(column.meaning) + (column.unit.empty() ? "" : Below(Escaped(column.unit)))});
  }
  text += columns.Text() + Heading(2, Code("runs.yaml"), "runs.yaml");
  for (const bool of_a_run : {false, true}) {
    text += of_a_run ? "Keys of each run:\n\n" : "Keys of the file:\n\n";
    Table keys({"Key", "Meaning"});
    for (const gap::RunsKey& key : gap::RunsFileKeys()) {
      if (key.of_a_run != of_a_run) continue;
      const std::string otherwise = key.otherwise.empty() ? "required" : "default: " + Prose(key.otherwise);
      keys.Row(
          {Target(key.name, key.name), Prose(key.meaning) + Below(Prose(key.accepted) + " · " + otherwise)});
    }
    text += keys.Text();
  }
  text += Heading(2, "Example", "example") + "A list of two runs, and the first rows of one:\n\n" +
          Example(source);
  return {"data-set.md", text};
}

}  // namespace tendril::reference
