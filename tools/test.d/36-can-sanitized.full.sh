# The node under address and undefined-behaviour sanitizers: its unit tests. (Step 39 fuzzes it.)
build_preset sanitize canopen_test canopen_soak_test
build/sanitize/firmware/canopen/canopen_test --gtest_brief=1
build/sanitize/firmware/testing/canopen_soak_test --gtest_brief=1
