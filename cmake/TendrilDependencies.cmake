# Everything comes from Debian 12 (tools/setup installs it); nothing is downloaded at configure time.
find_package(Threads REQUIRED)
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
find_package(yaml-cpp 0.7 REQUIRED)
find_package(SUNDIALS 6 REQUIRED COMPONENTS cvode nvecserial sunmatrixdense sunlinsoldense)
find_package(fmt 9 REQUIRED)
find_package(spdlog REQUIRED)
find_package(nlohmann_json 3 REQUIRED)
find_package(CLI11 2 REQUIRED)
find_package(LCM REQUIRED)
find_package(OpenSSL REQUIRED COMPONENTS Crypto)
find_package(Ceres 2 REQUIRED)  # bounded least squares of the gap diagnosis

find_path(READERWRITERQUEUE_INCLUDE_DIR readerwriterqueue/readerwriterqueue.h REQUIRED)
add_library(readerwriterqueue INTERFACE)
target_include_directories(readerwriterqueue SYSTEM INTERFACE ${READERWRITERQUEUE_INCLUDE_DIR})

if(TENDRIL_TESTS)
  find_package(GTest REQUIRED)
  include(GoogleTest)
endif()
if(TENDRIL_BENCH)
  find_package(benchmark REQUIRED)
endif()
