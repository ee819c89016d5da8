# Libraries that the wheel links, chosen so that it may be distributed under any licence and is fast on any processor:
# - Ceres from Debian's source package without SuiteSparse, CXSparse, LAPACK, glog and gflags. (Debian's libceres.a
#   links CHOLMOD, parts of which are under the GPL.) `./dev wheel` fetches the source; an sdist contains it.
# - OpenBLAS from PyPI's scipy-openblas32, whose symbols begin with scipy_.
set(ceres_version 2.1.0)
set(ceres_archive ${PROJECT_SOURCE_DIR}/.cache/sdist/ceres-solver_2.1.0+really2.1.0+dfsg.orig.tar.xz)
set(ceres_sha256 acd5774187a8ea92bdf9e6d1faeb22c00bf30b1ad226ef6e2ade8b7636bbc336)
set(ceres_dir ${PROJECT_SOURCE_DIR}/.cache/ceres-${ceres_version})

if(NOT EXISTS ${ceres_dir}/lib/libceres.a)
  if(NOT EXISTS ${ceres_archive})
    message(FATAL_ERROR "${ceres_archive} is missing: run ./dev wheel, which fetches it")
  endif()
  file(SHA256 ${ceres_archive} found_sha256)
  if(NOT found_sha256 STREQUAL ceres_sha256)
    message(FATAL_ERROR "${ceres_archive}: found SHA-256 ${found_sha256}, expected ${ceres_sha256}")
  endif()
  set(work ${CMAKE_BINARY_DIR}/ceres)
  file(ARCHIVE_EXTRACT INPUT ${ceres_archive} DESTINATION ${work})
  file(GLOB source LIST_DIRECTORIES true ${work}/ceres-solver*)
  message(STATUS "Compiling Ceres ${ceres_version} (one to two minutes, once)")
  # SCHUR_SPECIALIZATIONS is off: it compiles a hundred files for bundle adjustment, which the fitter does not use.
  execute_process(
    COMMAND ${CMAKE_COMMAND} -G Ninja -S ${source} -B ${work}/build -DCMAKE_BUILD_TYPE=Release
            -DCMAKE_C_COMPILER=${CMAKE_C_COMPILER} -DCMAKE_CXX_COMPILER=${CMAKE_CXX_COMPILER}
            -DCMAKE_CXX_COMPILER_LAUNCHER=${CMAKE_CXX_COMPILER_LAUNCHER}
            -DCMAKE_POSITION_INDEPENDENT_CODE=ON -DBUILD_SHARED_LIBS=OFF
            -DSUITESPARSE=OFF -DCXSPARSE=OFF -DLAPACK=OFF -DGFLAGS=OFF -DMINIGLOG=ON -DEIGENSPARSE=ON
            -DSCHUR_SPECIALIZATIONS=OFF -DBUILD_TESTING=OFF -DBUILD_EXAMPLES=OFF -DBUILD_BENCHMARKS=OFF
            -DPROVIDE_UNINSTALL_TARGET=OFF -DCMAKE_INSTALL_LIBDIR=lib -DCMAKE_INSTALL_PREFIX=${ceres_dir}
    COMMAND_ERROR_IS_FATAL ANY OUTPUT_QUIET ERROR_QUIET)
  execute_process(COMMAND ${CMAKE_COMMAND} --build ${work}/build --target install COMMAND_ERROR_IS_FATAL ANY OUTPUT_QUIET)
endif()
set(Ceres_DIR ${ceres_dir}/lib/cmake/Ceres)

find_package(Python 3.11 COMPONENTS Interpreter REQUIRED)
execute_process(COMMAND ${Python_EXECUTABLE} -c "import scipy_openblas32 as b; print(b.get_lib_dir(), b.get_library(fullname=True))"
                OUTPUT_STRIP_TRAILING_WHITESPACE OUTPUT_VARIABLE openblas COMMAND_ERROR_IS_FATAL ANY)
string(REPLACE " " "/" openblas "${openblas}")
add_library(armtrue_openblas INTERFACE)
target_link_libraries(armtrue_openblas INTERFACE ${openblas})
# The names of the BLAS and LAPACK routines that are called, read from the one file that declares them. If a name were
# missing here, the module would link, but Python could not import it.
file(STRINGS ${PROJECT_SOURCE_DIR}/fitter/common/dense.cc declared REGEX "^void [a-z0-9]+_\\(")
list(TRANSFORM declared REPLACE "^void ([a-z0-9]+_)\\(.*" "\\1")
foreach(name ${declared} openblas_set_num_threads)
  target_compile_definitions(armtrue_openblas INTERFACE ${name}=scipy_${name})
endforeach()
add_library(LAPACK::LAPACK ALIAS armtrue_openblas)
