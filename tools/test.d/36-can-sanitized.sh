# The node under address and undefined-behaviour sanitizers: its unit tests. (Step 39 fuzzes it.)
build_preset sanitize canopen_test
build/sanitize/firmware/canopen/canopen_test --gtest_brief=1
