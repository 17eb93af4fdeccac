"""The step Measure: check the board, record, train and run the finished device."""
