// A data set as a Python object: never changed once made, so that it can be read without the GIL.
#pragma once

#include <memory>
#include <utility>

#include "tendril/gap/data_set.h"

namespace tendril::python {

class Set {
 public:
  explicit Set(gap::DataSet set) : set_(std::make_shared<const gap::DataSet>(std::move(set))) {}
  const gap::DataSet& operator*() const { return *set_; }
  const gap::DataSet* operator->() const { return set_.get(); }

 private:
  std::shared_ptr<const gap::DataSet> set_;
};

}  // namespace tendril::python
