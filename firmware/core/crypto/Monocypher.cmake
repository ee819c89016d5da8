# Monocypher's C source, from the source package of PyPI's pymonocypher. Pinned by hash, fetched once, not part of this
# repository.
set(sdist_dir ${PROJECT_SOURCE_DIR}/.cache/sdist)
set(monocypher_dir ${CMAKE_BINARY_DIR}/monocypher)
set(monocypher_pin ${CMAKE_CURRENT_LIST_DIR}/monocypher-source.txt)
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${monocypher_pin})
file(STRINGS ${monocypher_pin} pin_line REGEX "^pymonocypher==")
string(REGEX REPLACE "^pymonocypher==([^ ]+) --hash=sha256:([0-9a-f]+)$" "\\1;\\2" pin "${pin_line}")
list(GET pin 0 monocypher_version)
list(GET pin 1 monocypher_sha256)
set(monocypher_archive ${sdist_dir}/pymonocypher-${monocypher_version}.tar.gz)

if(NOT EXISTS ${monocypher_archive})
  execute_process(
    COMMAND ${PROJECT_SOURCE_DIR}/.venv/bin/python -m pip download --quiet --disable-pip-version-check --no-deps
            --no-binary :all: --no-build-isolation --require-hashes --dest ${sdist_dir} -r ${monocypher_pin}
    RESULT_VARIABLE download_status)
  if(NOT download_status EQUAL 0)
    message(FATAL_ERROR "Monocypher's source could not be fetched: run ./dev build once with a network, which makes .venv and ${sdist_dir}")
  endif()
endif()
file(SHA256 ${monocypher_archive} found_sha256)
if(NOT found_sha256 STREQUAL monocypher_sha256)
  message(FATAL_ERROR "${monocypher_archive}: found SHA-256 ${found_sha256}, expected ${monocypher_sha256}")
endif()
if(NOT EXISTS ${monocypher_dir}/monocypher.c)
  file(ARCHIVE_EXTRACT INPUT ${monocypher_archive} DESTINATION ${monocypher_dir}/unpacked)
  foreach(name monocypher.c monocypher.h)
    file(COPY ${monocypher_dir}/unpacked/pymonocypher-${monocypher_version}/${name} DESTINATION ${monocypher_dir})
  endforeach()
endif()

# Third-party code: compiled unchanged and without this project's warnings.
add_library(monocypher STATIC ${monocypher_dir}/monocypher.c)
target_include_directories(monocypher SYSTEM PUBLIC ${monocypher_dir})
target_compile_definitions(monocypher PRIVATE BLAKE2_NO_UNROLLING)
