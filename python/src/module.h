// What the files of the module tendril._core share: each adds its names. Knows no room.
#pragma once

#include <nanobind/nanobind.h>

namespace tendril::python {

void AddRobot(nanobind::module_& m);
void AddModel(nanobind::module_& m);
void AddDataSet(nanobind::module_& m);
void AddSimulate(nanobind::module_& m);
void AddDiagnose(nanobind::module_& m);
void AddLog(nanobind::module_& m);
void AddReplay(nanobind::module_& m);
void AddClient(nanobind::module_& m);
void AddStatus(nanobind::module_& m);

}  // namespace tendril::python
