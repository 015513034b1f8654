"""What is scored, how, and the tables: tracking, the paper, identification, speed."""
