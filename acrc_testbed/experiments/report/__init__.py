"""What campaigns and single runs show, on one page: sentences, pictures, the numbers behind each."""
