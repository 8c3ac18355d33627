// Runs replayed by the simulator, for who draws a robot beside the measured one.
#include <nanobind/eigen/dense.h>
#include <nanobind/nanobind.h>

#include "module.h"
#include "tendril/gap/replayed_shape.h"

namespace tendril::python {

void AddReplay(nanobind::module_& m) {
  namespace nb = nanobind;
  m.def("replayed_shape", &gap::ReplayedShape, nb::arg("robot"), nb::arg("run"), nb::arg("times"),
        nb::call_guard<nb::gil_scoped_release>());
}

}  // namespace tendril::python
